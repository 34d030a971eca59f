"""Joint motions through way-points that round their corners, for tests and benchmarks of timing and segments."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PPoly

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.trajectory.timing import Trajectory, time_curve, time_path


def blended(q: npt.ArrayLike, deviation: float) -> PPoly:
    """Connect way-points q (m, n) by straight pieces and parabolas at most `deviation` rad (Euclidean) off the corners.

    In a parabola that begins and ends at a distance l from its corner, the direction changes at a constant rate from
    d0 to d1, and the curve passes the corner at a distance of |d1 - d0| l / 4.

    The way-points must differ from one to the next.
    """
    points = np.asarray(q, dtype=float)
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
        if straight > 1e-9:
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


def time_blended(q: npt.ArrayLike, limits: Limits, blend: float = 0.02) -> Trajectory:
    """Time way-points (m, n) rad from rest to rest, with corners rounded by at most `blend` rad."""
    return time_path(q, limits) if len(np.asarray(q)) == 2 else time_curve(blended(q, blend), limits)
