"""Time as the controller lives it. With a real arm it is wall time; an emulated one may live faster.

All waiting of the driver goes through its clock, so that `driver.line.stepped_clock.SteppedClock` can take
the place of this
one: there time passes only while the driver waits.
"""

from __future__ import annotations

import queue
import time
from typing import TypeVar

_T = TypeVar("_T")


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

    def at_least(self, seconds: float, wall_s: float) -> float:
        """That many controller seconds, but never less than `wall_s` of wall time: a busy host may sleep so long."""
        return max(seconds, wall_s * self.time_scale)

    def next_of(self, items: queue.SimpleQueue[_T], until: float) -> _T:
        """The next item, waited for until that controller time.

        Raises:
            queue.Empty: none came.
        """
        wait = self.wall(until - self.now())
        return items.get(timeout=wait) if wait > 0.0 else items.get_nowait()

    def unique_ms(self) -> int:
        """Milliseconds of a counter that an earlier program on this host has left behind."""
        return time.monotonic_ns() // 1_000_000
