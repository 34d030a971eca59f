"""How long joint motions take under velocity and acceleration limits, before they are timed in full."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits
from arm.se3 import Array


def straight_time(step: npt.ArrayLike, limits: Limits) -> Array:
    """Time (...) in s of straight joint moves by `step` (..., n) rad from rest to rest, all joints in step.

    Exact: along the line the speed profile is a trapezoid, or a triangle where the way is short.
    """
    way = np.abs(np.asarray(step, dtype=float))
    # times to run the way at full speed, and to run it at full acceleration from rest
    cruise = (way / limits.velocity).max(axis=-1)
    surge = (way / limits.acceleration).max(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        trapezoid = cruise + np.where(cruise > 0.0, surge / cruise, 0.0)
    return np.asarray(np.where(surge > cruise**2, 2.0 * np.sqrt(surge), trapezoid))


def path_times(
    waypoints: npt.ArrayLike,
    limits: Limits,
    enter: Array | None = None,
    leave: Array | None = None,
) -> Array:
    """Estimates (...) in s for straight joint lines through way-points (..., m, n) rad.

    Every line at full speed without stops between, and at each corner (and at both ends) half the time that the
    change of velocity takes; for a single long line from rest to rest this is exact.

    Args:
        waypoints: (..., m, n) rad.
        limits: of velocity and acceleration.
        enter, leave: velocities (..., n) rad/s before and after; default: at rest.
    """
    steps = np.diff(np.asarray(waypoints, dtype=float), axis=-2)
    times = (np.abs(steps) / limits.velocity).max(axis=-1)
    velocities = steps / np.maximum(times, 1e-12)[..., None]
    rest = np.zeros_like(velocities[..., :1, :])
    before = rest if enter is None else rest + enter[..., None, :]
    after = rest if leave is None else rest + leave[..., None, :]
    jumps = np.abs(np.diff(np.concatenate([before, velocities, after], axis=-2), axis=-2))
    turning = (jumps / limits.acceleration).max(axis=-1)
    return np.asarray(times.sum(axis=-1) + 0.5 * turning.sum(axis=-1))


def path_time(
    waypoints: npt.ArrayLike, limits: Limits, enter: Array | None = None, leave: Array | None = None
) -> float:
    """`path_times` of one path (m, n)."""
    return float(path_times(waypoints, limits, enter, leave))
