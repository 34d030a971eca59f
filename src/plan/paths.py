"""Geometry of joint paths, with no time: piecewise polynomials q(s) with continuous direction.

All are `scipy.interpolate.PPoly` over s, with values (6,): `path(s)`, `path(s, 1)`, `path(s, 2)`; `path.x` are the
places where the second derivative may jump.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, PPoly

from arm.errors import InputError
from arm.se3 import Array

Path = Any  # scipy.interpolate.PPoly; the library has no types

_SAME = 1e-9  # rad between way-points that count as one


def smooth_path(q: npt.ArrayLike, s: npt.ArrayLike) -> Path:
    """The cubic spline through way-points q (n, 6) at s (n,); for dense samples of a smooth curve."""
    return CubicSpline(np.asarray(s, dtype=float), np.asarray(q, dtype=float), bc_type="not-a-knot")


def polyline(q: npt.ArrayLike) -> Path:
    """Straight pieces between way-points q (n, 6), s being the distance in joint space in rad; corners stay sharp.

    Raises:
        InputError: fewer than two different way-points.
    """
    points = _distinct(q)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    return PPoly(np.stack([np.diff(points, axis=0) / lengths[:, None], points[:-1]]), s)


def blended(q: npt.ArrayLike, deviation: float) -> Path:
    """Straight pieces joined by parabolas, at most `deviation` rad (Euclidean, in joint space) off each corner.

    In a parabola that begins and ends a distance l from its corner, the direction turns at a constant rate from d0
    to d1, and the curve passes |d1 - d0| l / 4 from the corner.

    Raises:
        InputError: fewer than two different way-points, or a deviation that is not positive.
    """
    if not deviation > 0.0:
        raise InputError(
            f"blend = {deviation:g} rad: must be positive; a sharp corner needs a stop", value=deviation
        )
    points = _distinct(q)
    steps = np.diff(points, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    directions = steps / lengths[:, None]
    bends = np.diff(directions, axis=0)
    sharpness = np.linalg.norm(bends, axis=1)
    room = np.minimum(lengths[:-1], lengths[1:]) / 2.0
    cut = np.minimum(room, 4.0 * deviation / np.maximum(sharpness, 1e-12))
    cut[sharpness < 1e-9] = 0.0
    before, after = np.concatenate([[0.0], cut]), np.concatenate([cut, [0.0]])

    pieces: list[tuple[float, Array]] = []
    for i, (start, direction) in enumerate(zip(points[:-1], directions, strict=True)):
        straight = lengths[i] - before[i] - after[i]
        if straight > _SAME:
            pieces.append((straight, np.stack([0.0 * direction, direction, start + before[i] * direction])))
        if i < len(cut) and cut[i] > 0.0:
            pieces.append(
                (
                    2 * cut[i],
                    np.stack([bends[i] / (4 * cut[i]), direction, points[i + 1] - cut[i] * direction]),
                )
            )
    s = np.concatenate([[0.0], np.cumsum([length for length, _ in pieces])])
    return PPoly(np.stack([c for _, c in pieces], axis=1), s)


def _distinct(q: npt.ArrayLike) -> Array:
    points = np.atleast_2d(np.asarray(q, dtype=float))
    keep = np.ones(len(points), dtype=bool)
    keep[1:] = np.linalg.norm(np.diff(points, axis=0), axis=1) > _SAME
    points = points[keep]
    if len(points) < 2:
        raise InputError("a path needs two different way-points", count=len(points))
    return np.asarray(points)
