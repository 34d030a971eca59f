"""Few points and one radius that enclose a hull of many points, such as that of a mesh."""

from __future__ import annotations

from itertools import product

import numpy as np

from arm.numerics.products import mul
from arm.se3 import Array, frozen

# Directions to the faces, edges and corners of a cube.
_DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_MOST = 40  # points
_NEAR = 0.02  # radius, relative to the longest edge of the box around the points, that needs no further point
_STEPS = 8  # towards the nearest point of the hull of few points, for each point that is added


def few_points(points: Array) -> tuple[Array, float]:
    """Return at most 40 of the points (m, 3) and a radius; balls about them have a hull that contains all points.

    These are the points furthest out in 26 directions, then always the one furthest from the hull of those before it.
    The radius is the largest distance of a point from this hull, bounded by its distance from some point of the hull:
    that found by a descent (M. Frank, P. Wolfe, "An algorithm for quadratic programming", 1956).
    """
    if len(points) <= _MOST:
        return points, 0.0
    kept = np.unique(np.argmax(np.round(mul(points, _DIRECTIONS.T), 9), axis=0))
    nearest = np.repeat(points[kept[:1]], len(points), axis=0)  # a point of the hull for each point
    enough = _NEAR * float(np.ptp(points, axis=0).max())
    while True:
        few = points[kept]
        for _ in range(_STEPS):
            gap = points - nearest
            step = few[np.argmax(mul(gap, few.T), axis=1)] - nearest
            square = np.maximum((step * step).sum(axis=1), 1e-18)
            nearest += np.clip((gap * step).sum(axis=1) / square, 0.0, 1.0)[:, None] * step
        gap = points - nearest
        away = np.sqrt((gap * gap).sum(axis=1))
        if len(kept) == _MOST or away.max() <= enough:
            return frozen(few), float(away.max())
        kept = np.append(kept, np.argmax(np.round(away, 9)))
