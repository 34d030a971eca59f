"""Time as the controller lives it. With a real arm it is wall time; an emulated one may live faster."""

from __future__ import annotations

import time


class Clock:
    """A steady clock in controller seconds.

    Args:
        time_scale: controller seconds per wall second; 1 for hardware.
    """

    def __init__(self, time_scale: float = 1.0) -> None:
        self.time_scale = time_scale
        self._start = time.monotonic()

    def now(self) -> float:
        """Controller seconds since this clock was made."""
        return (time.monotonic() - self._start) * self.time_scale

    def sleep(self, seconds: float) -> None:
        """Wait that many controller seconds."""
        if seconds > 0.0:
            time.sleep(seconds / self.time_scale)

    def wall(self, seconds: float) -> float:
        """Wall seconds of that many controller seconds, for timeouts of system calls."""
        return seconds / self.time_scale
