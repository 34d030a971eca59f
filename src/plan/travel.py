"""How long joint motions take under velocity and acceleration limits, before they are timed in full."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from arm.unit import Limits


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


def path_time(waypoints: Array, limits: Limits) -> float:
    """Estimate in s for straight joint lines through way-points (m, n) rad, from rest to rest without stops between.

    Every line at full speed, and at each corner (and at both ends) half the time that the change of velocity takes;
    for a single long line this is exact.
    """
    steps = np.diff(waypoints, axis=0)
    times = (np.abs(steps) / limits.velocity).max(axis=1)
    steps, times = steps[times > 0.0], times[times > 0.0]
    if not len(times):
        return 0.0
    rest = np.zeros((1, steps.shape[1]))
    velocities = np.concatenate([rest, steps / times[:, None], rest])
    turning = (np.abs(np.diff(velocities, axis=0)) / limits.acceleration).max(axis=1)
    return float(times.sum() + 0.5 * turning.sum())
