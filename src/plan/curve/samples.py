"""Samples of the free directions of a curve on a grid, and which of them are neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from arm.errors import InputError
from arm.se3 import Array, Bools, Indices, frozen
from plan.curve.tool_curve import ToolCurve

_TILT_STEP = np.radians(15.0)  # rad, between tilts: a lattice of equilateral triangles
_TURN_STEP = np.radians(20.0)  # rad, between rotations about z, and about x and y with a range of their own
_SHIFT_STEP = 0.03  # m, between positions; a range of less than
_LEAST_SHIFT = (
    0.015  # m to either side is left to the smoothing, because samples multiply with each direction
)
_SAME = 1e-9
MOST = 3500  # samples; the memory of a graph grows with their number times that of their neighbours


@dataclass(frozen=True, eq=False)
class Samples:
    """A grid of coordinates.

    Attributes:
        coordinates: (k, 6), see `plan.kinematics.freedom.coordinates_of`.
        neighbours: (k, l) of each, itself included; rows with fewer repeat the sample itself.
    """

    coordinates: Array
    neighbours: Indices


def samples_of(curve: ToolCurve) -> Samples:
    """Return samples that cover what is free at each place of a curve; the least deviation from its poses is first.

    Raises:
        InputError: there would be more than `MOST`.
    """
    low, high = curve.box()
    axes: list[Array] = []
    near: list[Bools] = []
    values: Array
    for columns in ([0], [1], [2], [3, 4], [5]):
        if columns == [3, 4] and curve.freedom.tilt > 0.0:
            values, touching = _disc(curve.freedom.tilt)
        elif columns == [3, 4]:
            grid = [_row(low[k], high[k], _TURN_STEP) for k in columns]
            values = np.array(list(product(*grid)), dtype=float)
            steps = [np.abs(np.subtract.outer(*[np.searchsorted(grid[i], values[:, i])] * 2)) for i in (0, 1)]
            touching = np.maximum(*steps) <= 1
        elif columns == [5] and np.isinf(high[5]):
            count = int(np.ceil(2.0 * np.pi / _TURN_STEP))
            values = np.arange(count, dtype=float)[:, None] * (2.0 * np.pi / count) - np.pi
            apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
            touching = np.minimum(apart, count - apart) <= 1
        else:
            step, least = (_TURN_STEP, 0.0) if columns == [5] else (_SHIFT_STEP, _LEAST_SHIFT)
            row = _row(low[columns[0]], high[columns[0]], step, least)
            values, touching = row[:, None], np.abs(np.subtract.outer(*[np.arange(len(row))] * 2)) <= 1
        axes.append(values)
        near.append(touching)
    count = int(np.prod([len(values) for values in axes]))
    if count > MOST:
        raise InputError(
            f"path: what is free makes {count} samples at each place, must be at most {MOST}; narrow ranges, or free "
            "fewer directions",
            samples=count,
        )
    index = np.array(list(product(*(range(len(values)) for values in axes))))
    coordinates = np.concatenate([values[index[:, i]] for i, values in enumerate(axes)], axis=1)
    size = np.abs(np.where(np.isinf(high), 0.0, coordinates))
    order = np.argsort(np.round(size.sum(axis=1), 9), kind="stable")
    index, coordinates = index[order], coordinates[order]
    together = np.ones((len(index), len(index)), dtype=bool)
    for i, some in enumerate(near):
        together &= some[index[:, i][:, None], index[:, i][None, :]]
    most = int(together.sum(axis=1).max())
    neighbours = np.tile(np.arange(len(index))[:, None], (1, most))
    for number, beside in enumerate(together):
        found = np.flatnonzero(beside)
        neighbours[number, : len(found)] = found
    return Samples(frozen(coordinates), neighbours.astype(np.intp))


def _row(low: float, high: float, step: float, least: float = 0.0) -> Array:
    """Return values at most `step` apart from the lowest to the highest, the one nearest to 0 among them.

    A side of that value that is shorter than `least` has none.
    """
    middle = float(np.clip(0.0, low, high))
    low, high = (middle if abs(end - middle) < least else end for end in (low, high))
    below, above = (int(np.ceil(side / step - _SAME)) for side in (middle - low, high - middle))
    return np.concatenate([np.linspace(low, middle, below + 1)[:-1], np.linspace(middle, high, above + 1)])


def _disc(tilt: float) -> tuple[Array, Bools]:
    """Return a lattice of equilateral triangles on a disc of tilts, (k, 2) rad, and which are neighbours, (k, k)."""
    rings = max(1, int(np.ceil(tilt / _TILT_STEP - _SAME)))
    spacing = tilt / rings
    points = [
        (spacing * (i + 0.5 * j), spacing * np.sqrt(0.75) * j)
        for i, j in product(range(-rings, rings + 1), repeat=2)
        if abs(i + j) <= rings
    ]
    values = np.array(points)
    apart = values[:, None] - values
    return values, np.asarray(np.sqrt((apart**2).sum(axis=2)) <= 1.1 * spacing)
