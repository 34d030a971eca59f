"""Records of the arm's positions, millisecond by millisecond, and of violations."""

from __future__ import annotations

import threading
from array import array
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Counts

_INT32 = 2**31
_CHUNK = 4096  # samples


@dataclass(frozen=True)
class Violation:
    """A command that a correct driver never sends; the unit executes or ignores it without an answer.

    Attributes:
        time_ms: emulated.
        what: description.
    """

    time_ms: int
    what: str


@dataclass(frozen=True)
class Record:
    """True positions in the homed convention at every executed ms of motion.

    Attributes:
        time_ms: emulated ms, (m,) int.
        counts: (m, 6) int.
    """

    time_ms: Counts
    counts: Counts


def no_record(after_ms: int) -> Record:
    """The record of an arm that never moved."""
    return Record(np.zeros(0, dtype=np.int64), np.zeros((0, 6), dtype=np.int64))


class Recorder:
    """Collects samples compactly.

    Args:
        axes: number of axes.
        keep: how many of the latest samples to keep, at least. None keeps all (32 bytes each).
    """

    def __init__(self, axes: int, keep: int | None = None) -> None:
        self._axes = axes
        self._keep = keep
        self._time = array("q")
        self._counts = array("i")
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._time)

    def add(self, time_ms: int, counts: tuple[int, ...]) -> None:
        """Add a sample; counts beyond 32 bits are clipped."""
        with self._lock:
            try:
                sample = array("i", counts)
            except OverflowError:
                sample = array("i", [min(max(c, -_INT32), _INT32 - 1) for c in counts])
            self._counts.extend(sample)
            self._time.append(time_ms)
            if self._keep is not None and len(self._time) > self._keep + self._keep // 8 + 1:
                old = len(self._time) - self._keep
                del self._time[:old]
                del self._counts[: old * self._axes]

    def record(self, after_ms: int = -1) -> Record:
        """Return a copy of the samples after a time. May be called from another thread."""
        with self._lock:
            first = bisect_right(self._time, after_ms)
            time = np.array(self._time[first:], dtype=np.int64)
            counts = np.array(self._counts[first * self._axes :], dtype=np.int64).reshape(-1, self._axes)
        time.flags.writeable = counts.flags.writeable = False
        return Record(time, counts)

    def last_motion(self) -> tuple[int, tuple[int, ...]]:
        """Return the ms of the last sample and the sign of each axis's last motion; zeros where there is none."""
        with self._lock:
            time_ms = self._time[-1] if self._time else 0
            signs, end = np.zeros(self._axes, dtype=np.int64), len(self._time)
            while end > 1 and not signs.all():  # latest samples first: mostly they suffice
                begin = max(end - _CHUNK, 0)
                part = self._counts[begin * self._axes : end * self._axes]
                steps = np.sign(np.diff(np.array(part, dtype=np.int64).reshape(-1, self._axes), axis=0))
                for axis in np.flatnonzero((signs == 0) & steps.any(axis=0)):
                    signs[axis] = steps[np.flatnonzero(steps[:, axis])[-1], axis]
                end = begin + 1 if begin else 0
        return time_ms, tuple(int(s) for s in signs)
