"""Where the true tool was, at regular times, from the unit's record of the arm."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from driver.emulator.unit.record import Record

NODE_MS = 10  # between two poses


class ToolTrack:
    """Poses of the tool every `NODE_MS`, whenever they are asked for.

    Args:
        pose: returns the true pose of the tool at counts, with errors (6,) rad of an arrival, at a time in ms.

    Attributes:
        at_ms: time of the last pose that was given.
    """

    def __init__(self, pose: Callable[[npt.ArrayLike, Array, int], Array]) -> None:
        self._pose = pose
        self.at_ms = 0
        self._counts: npt.ArrayLike | None = None  # there
        self._arrived = np.zeros(6)
        self._there: Array | None = None

    def new_poses(self, samples: Record, now_ms: int, arrived: Array | None) -> Iterator[Array]:
        """The poses after `at_ms`, up to `now_ms`; one object while the arm rests, and none before its first motion.

        Args:
            samples: of the arm after `at_ms`.
            now_ms: the present, or the last sample's time if that is later.
            arrived: errors (6,) rad of the arrival at which the arm rests, None while it moves. From one arrival to
                the next they change linearly.
        """
        times = np.arange(self.at_ms + NODE_MS, now_ms + 1, NODE_MS)
        rows = np.searchsorted(samples.time_ms, times, side="right") - 1
        moving = int((times < samples.time_ms[-1]).sum()) + 1 if len(samples.time_ms) else 1
        before, after = self._arrived, self._arrived if arrived is None else arrived
        seen = -1
        for number, (time, row) in enumerate(zip(times.tolist(), rows.tolist(), strict=True), start=1):
            changes = row != seen or (number <= moving and after is not before)
            if row != seen:
                self._counts, seen = samples.counts[row], row
            if self._counts is None:
                continue
            if changes or self._there is None:
                share = min(number / moving, 1.0)
                self._there = self._pose(self._counts, (1.0 - share) * before + share * after, time)
            self.at_ms = time
            yield self._there
        self._arrived = after
        if len(times):
            self.at_ms = int(times[-1])
