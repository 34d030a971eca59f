"""Controller time: wall time with a real arm; faster than wall time with an emulated one, if wanted.

The driver waits through its clock only, so `driver.line.stepped_clock.SteppedClock` can replace this one: there time
passes only while the driver waits.
"""

from __future__ import annotations

import queue
import time
from typing import TypeVar

_T = TypeVar("_T")

LEAST_WALL_S = 1.0  # shortest time limit in wall time, as a busy host may suspend this process that long


class Clock:
    """A monotonic clock in controller seconds.

    Args:
        time_scale: controller seconds per wall second; 1 for hardware.
    """

    def __init__(self, time_scale: float = 1.0) -> None:
        self.time_scale = time_scale
        self._start = time.monotonic()

    def now(self) -> float:
        """Controller seconds since this clock was created."""
        return (time.monotonic() - self._start) * self.time_scale

    def sleep(self, seconds: float) -> None:
        """Wait for that many controller seconds."""
        if seconds > 0.0:
            time.sleep(seconds / self.time_scale)

    def wall(self, seconds: float) -> float:
        """Convert controller seconds to wall seconds, for timeouts of system calls."""
        return seconds / self.time_scale

    def at_least(self, seconds: float, wall_s: float) -> float:
        """Return `seconds`, extended to at least `wall_s` of wall time, as a busy host may be suspended that long."""
        return max(seconds, wall_s * self.time_scale)

    def patience(self, seconds: float) -> float:
        """Return that many controller seconds, but at least LEAST_WALL_S of wall time: the host may be busy."""
        return self.at_least(seconds, LEAST_WALL_S)

    def next_of(self, items: queue.SimpleQueue[_T], until: float) -> _T:
        """Return the next item; wait for it until controller time `until`.

        Raises:
            queue.Empty: none came.
        """
        wait = self.wall(until - self.now())
        return items.get(timeout=wait) if wait > 0.0 else items.get_nowait()

    def unique_ms(self) -> int:
        """Return a count of milliseconds that is higher than in any earlier program on this host."""
        return time.monotonic_ns() // 1_000_000
