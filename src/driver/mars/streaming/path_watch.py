"""Check that the arm is on its path: the last defence against a unit that executes something else than was sent.

If the unit echoes, this check only has to detect an arm that does not follow. Each axis must be inside the box around
the segments being executed.

If the unit does not echo, nothing else detects a damaged segment. Each axis must then be where the path was at some
time from `LAG_MOST_S` ago to now. The lag must also be consistent from sample to sample, because a servo lags by about
the same time throughout. It is tracked as a set-membership estimate: the set of lags that all samples so far allow,
widened after each sample by the most that a lag may change.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from arm.controller.segments import CountPath
from arm.errors import ExecutionStopped
from arm.se3 import Array

LAG_SEGMENTS = 3  # segments by which the servos may lag behind the reference
ASTRAY = 2  # samples in a row off the path that count: a single one may be damaged on the line
LAG_MOST_S = 0.15  # longest servo lag; that of the real servos is not known
LAG_CHANGE_S = 0.02  # largest change of an axis' lag between two samples
_STEP_S = 0.005
_EARLY_STEPS = 2  # of negative lag: the unit may read the position slightly later than the parameter
_CHANGE_STEPS = round(LAG_CHANGE_S / _STEP_S)


class PathWatch:
    """Compares position samples with the path.

    Args:
        path: planned path, with as many segments as are sent.
        axes: axis letters, for the message.
        box_counts: how far any axis may be outside the box around the sent segments, from `LAG_SEGMENTS` before the
            present one.
        tube_counts: how far any axis may be from the path within the lag, if the unit does not echo; None: check the
            box only.

    Attributes:
        doubtful: the last sample was off the path; the next one decides.
    """

    def __init__(
        self, path: CountPath, axes: Sequence[str], box_counts: int, tube_counts: int | None
    ) -> None:
        self._path = path
        self._knots = path.knots()
        self._begins = np.concatenate([[0.0], np.cumsum([s.duration_ms / 1e3 for s in path.segments])])
        self._axes = axes
        self._box, self._tube = box_counts, tube_counts
        self._astray = 0
        steps = round(LAG_MOST_S / _STEP_S)
        self._lags = np.arange(-_EARLY_STEPS, steps + 1) * _STEP_S
        self._possible = np.ones((len(self._lags) - 1, len(axes)), dtype=bool)  # lags that all samples allow

    @property
    def doubtful(self) -> bool:
        return self._astray > 0

    def take(
        self, counts: tuple[int, ...], begun: int, sent: int, share: float | None = None, sure: bool = True
    ) -> None:
        """Check a sample taken while segment `begun` runs (from 1; 0 is the dwell) and `sent` have been sent.

        Args:
            share: fraction of that segment that is done, 0 to 1; None if not known.
            sure: the segment number is certain; if not, only the box is checked.

        Raises:
            ExecutionStopped: the arm is off its path, twice in a row; reason ``following``.
        """
        if self._tube is None or not sure:
            outside, most = self._out_of_box(counts, begun, sent), self._box
        else:
            outside, most = self._off_tube(counts, begun, share, self._tube), self._tube
        worst = int(np.argmax(outside))
        self._astray = self._astray + 1 if outside[worst] > most else 0
        if self._astray >= ASTRAY:
            why = f"axis {self._axes[worst]} is {int(outside[worst])} counts off its path, must be at most {most}"
            raise ExecutionStopped(why, axis=self._axes[worst], counts=list(counts), reason="following")

    def _out_of_box(self, counts: tuple[int, ...], begun: int, sent: int) -> Array:
        window = self._knots[max(begun - 1 - LAG_SEGMENTS, 0) : sent + 1]
        return np.asarray(np.maximum(window.min(axis=0) - counts, counts - window.max(axis=0)), dtype=float)

    def _off_tube(self, counts: tuple[int, ...], begun: int, share: float | None, most: int) -> Array:
        """Distance of each axis from the path over the possible lags. Keep only the lags that this sample allows."""
        off = self._off_by_lag(np.array(counts), begun, share)
        near = off <= most
        if share is not None and (near & self._possible).any(axis=0).all():
            self._possible &= _widened(near, _CHANGE_STEPS)
        return np.asarray(np.where(self._possible, off, np.inf).min(axis=0), dtype=float)

    def _off_by_lag(self, counts: npt.NDArray[np.int64], begun: int, share: float | None) -> Array:
        """Distance from the path for each lag and axis, (steps, 6) counts; the least one if `share` is not known."""
        segment = min(max(begun, 0), len(self._path.segments))
        start, end = self._begins[[max(segment - 1, 0), segment]]
        if begun == segment > 0 and share is None:
            nows = np.arange(start, end + _STEP_S, _STEP_S)
        else:
            now = start + share * (end - start) if begun == segment and share is not None else end
            nows = np.array([now])
        if nows[-1] >= end:
            nows = np.append(nows, end + LAG_MOST_S)  # the last segment may have ended some time ago
        times = np.minimum(nows[:, None] - self._lags[None, :], end)
        at = self._path.at(times.ravel()).reshape(*times.shape, -1)
        low, high = np.minimum(at[:, 1:], at[:, :-1]), np.maximum(at[:, 1:], at[:, :-1])
        off = np.maximum(np.maximum(low - counts, counts - high), 0.0)
        return np.asarray(off.min(axis=0), dtype=float)


def _widened(near: npt.NDArray[np.bool_], steps: int) -> npt.NDArray[np.bool_]:
    """Extend True entries by `steps` rows before and after."""
    wide = near.copy()
    for k in range(1, steps + 1):
        wide[k:] |= near[:-k]
        wide[:-k] |= near[k:]
    return wide
