"""What the arm did, millisecond by millisecond, and which rules were broken."""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array
from arm.unit import Counts


@dataclass(frozen=True)
class Violation:
    """Something that a careful driver never asks for; a unit does it, or ignores it, without a word.

    Attributes:
        time_ms: emulated.
        what: in words.
    """

    time_ms: int
    what: str


@dataclass(frozen=True)
class Record:
    """True positions in the homed convention at every executed ms while anything moved.

    Attributes:
        time_ms: emulated ms, (m,) int.
        counts: (m, 6) int.
    """

    time_ms: Counts
    counts: Counts

    def velocity(self) -> Array:
        """Counts/ms between successive samples of one motion, (k, 6); gaps between motions left out."""
        step = np.diff(self.time_ms)
        return np.asarray(np.diff(self.counts, axis=0)[step == 1], dtype=float)


class Recorder:
    """Collects samples compactly."""

    def __init__(self, axes: int) -> None:
        self._axes = axes
        self._time = array("q")
        self._counts = array("i")

    def add(self, time_ms: int, counts: tuple[int, ...]) -> None:
        """One sample."""
        self._counts.extend(counts)
        self._time.append(time_ms)  # last: a reader takes as many samples as there are times

    def record(self) -> Record:
        """A copy of everything so far. May be called from another thread."""
        time = np.array(self._time[:], dtype=np.int64)
        counts = np.array(self._counts[: len(time) * self._axes], dtype=np.int64).reshape(-1, self._axes)
        time.flags.writeable = counts.flags.writeable = False
        return Record(time, counts)
