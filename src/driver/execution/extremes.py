"""Extreme counts of a path of cubic segments, between its knots too."""

from __future__ import annotations

import math

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Counts


def extremes(path: CountPath) -> tuple[Counts, Counts]:
    """Return the lowest and highest counts of every axis over the path, (6,) each, rounded outwards."""
    knots = path.knots()
    low, high = knots.min(axis=0).astype(float), knots.max(axis=0).astype(float)
    for begin, segment in zip(knots[:-1], path.segments, strict=True):
        for u in _turning_points(segment):
            counts = begin + segment.displacement(u)
            low, high = np.minimum(low, counts), np.maximum(high, counts)
    return np.floor(low).astype(np.int64), np.ceil(high).astype(np.int64)


def _turning_points(segment: Segment) -> list[float]:
    """Parameters strictly inside a segment where an axis reverses: roots of a1 + 2 a2 u + 3 a3 u^2."""
    a1, a2, a3 = (*segment.coefficients, *([(0,) * len(segment.coefficients[0])] * 2))[:3]
    roots: list[float] = []
    for c, half_b, a in zip(a1, a2, (3 * v for v in a3), strict=True):
        discriminant = half_b * half_b - a * c
        if discriminant < 0:
            continue
        # quadratic formula without cancellation; also covers a = 0
        w = -(half_b + math.copysign(math.sqrt(discriminant), half_b))
        roots += [w / a] if a else []
        roots += [c / w] if w else []
    return [u for u in roots if 0.0 < u < 1.0]
