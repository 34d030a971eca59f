"""Estimates of the duration of joint motions under velocity and acceleration limits, without time parametrisation."""

from __future__ import annotations

from functools import reduce

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits
from arm.se3 import Array


def straight_time(step: npt.ArrayLike, limits: Limits) -> Array:
    """Return the times (...) in s of straight, synchronised joint moves by `step` (..., n) rad from rest to rest.

    The times are exact: the velocity profile is a trapezoid, or a triangle if the move is short.
    """
    distance = np.abs(np.asarray(step, dtype=float))
    return _rest_to_rest(_largest(distance, limits.velocity), _largest(distance, limits.acceleration))


def straight_times(starts: Array, ends: Array, limits: Limits) -> Array:
    """Return `straight_time` (k, m) from each of the `starts` (k, n) to each of the `ends` (m, n)."""
    cruise, surge = np.zeros((2, len(starts), len(ends)))
    step = np.empty_like(cruise)
    for k in range(starts.shape[1]):
        for largest, scale in ((cruise, limits.velocity[k]), (surge, limits.acceleration[k])):
            np.subtract(ends[:, k] / scale, starts[:, k, None] / scale, out=step)
            np.maximum(largest, np.abs(step, out=step), out=largest)
    return _rest_to_rest(cruise, surge)


def _rest_to_rest(cruise: Array, surge: Array) -> Array:
    """Return times (...) from those at full velocity (...) s, and the squares of those at full acceleration (...)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        trapezoid = cruise + np.where(cruise > 0.0, surge / cruise, 0.0)
    return np.asarray(np.where(surge > cruise**2, 2.0 * np.sqrt(surge), trapezoid))


def _largest(distance: Array, scale: Array) -> Array:
    """Return ``(distance / scale).max(axis=-1)``; numpy takes four times as long for a short last axis."""
    columns = (distance[..., k] / scale[k] for k in range(len(scale)))
    return reduce(np.maximum, columns)


def path_times(
    waypoints: npt.ArrayLike, limits: Limits, enter: Array | None = None, leave: Array | None = None
) -> Array:
    """Estimate the times (...) in s of straight joint lines through way-points, without stops.

    The estimate is every line at full velocity, plus half the time of the change of velocity at each corner and at both
    ends. It is exact for a single long line from rest to rest.

    Args:
        waypoints: (..., m, n) rad.
        limits: limits of velocity and acceleration.
        enter, leave: velocities (..., n) rad/s before and after; default: at rest.
    """
    steps = np.diff(np.asarray(waypoints, dtype=float), axis=-2)
    times = (np.abs(steps) / limits.velocity).max(axis=-1)
    velocities = steps / np.maximum(times, 1e-12)[..., None]
    rest = np.zeros_like(velocities[..., :1, :])
    before = rest if enter is None else rest + enter[..., None, :]
    after = rest if leave is None else rest + leave[..., None, :]
    jumps = np.abs(np.diff(np.concatenate([before, velocities, after], axis=-2), axis=-2))
    changes = (jumps / limits.acceleration).max(axis=-1)
    return np.asarray(times.sum(axis=-1) + 0.5 * changes.sum(axis=-1))


def path_time(
    waypoints: npt.ArrayLike, limits: Limits, enter: Array | None = None, leave: Array | None = None
) -> float:
    """Return `path_times` of one path (m, n)."""
    return float(path_times(waypoints, limits, enter, leave))
