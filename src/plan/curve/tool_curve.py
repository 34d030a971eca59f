"""A curve of the tool: poses along a path in space, and the directions that are free there."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np

from arm.errors import InputError
from arm.numerics.products import mul
from arm.se3 import Array, Indices, frozen, rotation_vector, rotations
from plan.kinematics.freedom import Freedom, placed
from plan.kinematics.numeric_ik import FREE
from plan.kinematics.straight_line import LineDeviation

_TURN = 0.05  # m per rad: the length of the curve counts this for each rad by which the tool turns
_LEAST = 1e-9  # m, least distance of two poses
# m, half widths of the searches for the place that a pose belongs to; free positions and turns move it from the nearest
_AROUND = (1e-2, 1.25e-3, 1.6e-4, 2e-5)
_APART, _CHUNK = 2.5e-3, 64  # m between places, and tools at a time, of the search over the whole curve


@dataclass(frozen=True, eq=False)
class ToolCurve:
    """Poses along a path, joined by straight lines and turns about fixed axes.

    Attributes:
        T: (m, 4, 4) T_base_tool, at least two different ones.
        freedom: directions that are free within limits, in the axes of the pose at each place.
        free: directions without limits, of `plan.kinematics.numeric_ik.FREE`: only rz.

    Raises:
        InputError: fewer than two different poses, or another direction without limits.
    """

    T: Array
    freedom: Freedom = field(default_factory=lambda: Freedom({}))
    free: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.T) < 2 or self.s[-1] <= _LEAST:
            raise InputError(
                f"a path of {len(self.T)} poses: must have at least two different ones", count=len(self.T)
            )
        wrong = [name for name in self.free if name != "rz"]
        if wrong:
            why = f"free = {wrong[0]!r}: on a path only rz may be free without limits; give it a range or a tilt"
            raise InputError(why, free=wrong)

    @cached_property
    def s(self) -> Array:
        """Place of each pose (m,): distance from the first along the path, m, and turns at 0.05 m per rad."""
        steps = np.diff(self.T[:, :3, 3], axis=0)
        sizes = np.sqrt((steps**2).sum(axis=1)) + _TURN * np.sqrt((self._turns**2).sum(axis=1))
        return frozen(np.concatenate([[0.0], np.cumsum(sizes)]))

    @cached_property
    def _turns(self) -> Array:
        """Rotation vectors (m - 1, 3) from each pose to the next, rad, in the axes of the first."""
        return np.array([rotation_vector(mul(a.T, b)) for a, b in pairwise(self.T[:, :3, :3])]).reshape(-1, 3)

    @property
    def length(self) -> float:
        """Distance along the path, m (see `s`)."""
        return float(self.s[-1])

    @property
    def T_start(self) -> Array:
        """Its first pose."""
        return np.asarray(self.T[0])

    @property
    def T_end(self) -> Array:
        """Its last pose."""
        return np.asarray(self.T[-1])

    def reversed(self) -> ToolCurve:
        """Return it from its end to its start."""
        return ToolCurve(frozen(self.T[::-1]), self.freedom, self.free)

    def stations(self, step: float) -> Array:
        """Return places (k,) from the start to the end that are at most `step` m apart, and nearly equally."""
        return np.linspace(0.0, self.length, max(2, int(np.ceil(self.length / step - 1e-9)) + 1))

    def poses(self, places: Array) -> Array:
        """Return the poses (k, 4, 4) at places (k,) m."""
        i = np.clip(np.searchsorted(self.s, places, side="right") - 1, 0, len(self.s) - 2)
        part = (places - self.s[i]) / np.maximum(np.diff(self.s)[i], 1e-300)
        T: Array = np.array(self.T[i])
        T[:, :3, 3] += part[:, None] * (self.T[i + 1, :3, 3] - self.T[i, :3, 3])
        T[:, :3, :3] = mul(T[:, :3, :3], rotations(part[:, None] * self._turns[i]))
        return T

    def placed(self, places: Array, coordinates: Array) -> Array:
        """Return the poses (k, 4, 4) with coordinates (k, 6) of the freedom at places (k,) m."""
        return placed(self.poses(places), coordinates)

    def box(self) -> tuple[Array, Array]:
        """Return lowest and highest value of each coordinate, (6,) each; infinite for a direction without limits."""
        return self.freedom.box(self.free)

    def excess(self, places: Array, T_base_tool: Array) -> tuple[Array, Array]:
        """Return how far tools (k, 4, 4) at places (k,) are beyond what is free: (k,) m and (k,) rad."""
        return self.freedom.excess(self.poses(places), T_base_tool, self.free)

    def nearest(self, points: Array) -> Array:
        """Return the places (k,) of the path nearest to points (k, 3) m."""
        begin, step = self.T[:-1, :3, 3], np.diff(self.T[:, :3, 3], axis=0)
        square = np.maximum((step * step).sum(axis=1), 1e-300)
        part = np.clip((mul(points, step.T) - (begin * step).sum(axis=1)) / square, 0.0, 1.0)
        foot = begin + part[..., None] * step
        away = ((points[:, None] - foot) ** 2).sum(axis=2)
        best: Indices = np.argmin(away, axis=1)
        rows = np.arange(len(points))
        return np.asarray(self.s[best] + part[rows, best] * np.diff(self.s)[best])

    def deviation(
        self, T_base_tool: Array, free_axis: str | None = None, fraction: Array | None = None
    ) -> LineDeviation:
        """Return how far poses (m, 4, 4) are beyond what is free at the best of the places near them.

        It has the signature of `plan.kinematics.straight_line.Line.deviation`; the free directions are the curve's own.
        """
        rows = np.arange(len(T_base_tool))
        places = self._places_near(T_base_tool) if fraction is None else fraction * self.length
        for width in _AROUND:
            near = np.clip(places[:, None] + np.linspace(-width, width, 17), 0.0, self.length)
            wanted = self.poses(near.ravel()).reshape(*near.shape, 4, 4)
            away, turned = self.freedom.excess(wanted, T_base_tool[:, None], self.free)
            best = self._best(away, turned)
            places = near[rows, best]
        return LineDeviation(away[rows, best], turned[rows, best])

    def _places_near(self, T_base_tool: Array) -> Array:
        """Return places (k,) of tools (k, 4, 4): the nearest, or where they are least beyond what is free.

        These differ if positions are free, and if the tool turns on the spot.
        """
        low, high = self.box()
        steps = np.sqrt((np.diff(self.T[:, :3, 3], axis=0) ** 2).sum(axis=1))
        if not (high[:3] > low[:3]).any() and (np.diff(self.s) <= 2.0 * steps).all():
            return self.nearest(T_base_tool[:, :3, 3])
        places = self.stations(_APART)
        wanted = self.poses(places)
        best = [
            self._best(*self.freedom.excess(wanted, some[:, None], self.free))
            for some in np.split(T_base_tool, range(_CHUNK, len(T_base_tool), _CHUNK))
        ]
        return np.asarray(places[np.concatenate(best)])

    @staticmethod
    def _best(away: Array, turned: Array) -> Indices:
        """Return the column of the least excess in each row."""
        return np.asarray(np.argmin(np.round(away + _TURN * turned, 9), axis=1))


def directions(curve: ToolCurve) -> list[int]:
    """Return the columns of coordinates that are free, of `plan.kinematics.numeric_ik.FREE`."""
    low, high = curve.box()
    return [k for k in range(len(FREE)) if high[k] > low[k]]
