"""Whether the arm is where its path is: the last means of noticing that what it executes is not what was sent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.errors import ExecutionStopped
from arm.motion import CountPath
from arm.se3 import Array

LAG_SEGMENTS = 3  # the arm follows its reference by regulators that lag
_STEPS = 24  # points of a segment
ASTRAY = 2  # samples in a row: one may have a digit lost on the line


class PathWatch:
    """Compares samples of the position with the segments about the one that runs.

    Args:
        path: planned, with as many segments as are sent.
        axes: letters, for the message.
        box_counts: how far any axis may be outside the box around all that is sent from `LAG_SEGMENTS` before.
        tube_counts: the same around the nearest point of segments n - 3 to n + 1 of the running one, where the line
            itself cannot be checked; None: no tube.
    """

    def __init__(
        self, path: CountPath, axes: Sequence[str], box_counts: int, tube_counts: int | None
    ) -> None:
        self._path = path
        self._knots = path.knots()
        self._axes = axes
        self._box, self._tube = box_counts, tube_counts
        self._astray = 0

    def take(self, counts: tuple[int, ...], begun: int, sent: int) -> None:
        """A sample, while segment `begun` (from 1; 0 is the dwell) runs and `sent` have been sent.

        Raises:
            ExecutionStopped: the arm is off its path, twice in a row; reason ``following``.
        """
        if self._tube is None:
            outside, most = self._out_of_box(counts, begun, sent), self._box
        else:
            outside, most = self._off_tube(counts, begun), self._tube
        worst = int(np.argmax(outside))
        self._astray = self._astray + 1 if outside[worst] > most else 0
        if self._astray >= ASTRAY:
            raise ExecutionStopped(
                f"axis {self._axes[worst]} is {int(outside[worst])} counts off its path, at most {most}",
                axis=self._axes[worst],
                counts=list(counts),
                reason="following",
            )

    def _out_of_box(self, counts: tuple[int, ...], begun: int, sent: int) -> Array:
        window = self._knots[max(begun - 1 - LAG_SEGMENTS, 0) : sent + 1]
        return np.asarray(np.maximum(window.min(axis=0) - counts, counts - window.max(axis=0)), dtype=float)

    def _off_tube(self, counts: tuple[int, ...], begun: int) -> Array:
        u = np.linspace(0.0, 1.0, _STEPS + 1)
        first, last = max(begun - 1 - LAG_SEGMENTS, 0), min(begun + 1, len(self._path.segments))
        points = np.concatenate(
            [self._knots[k] + self._path.segments[k].displacement(u) for k in range(first, last)]
            or [self._knots[:1]]
        )
        off = np.abs(points - np.array(counts))
        return np.asarray(off[int(np.argmin(off.max(axis=1)))], dtype=float)
