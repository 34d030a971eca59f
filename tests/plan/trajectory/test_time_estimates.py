"""Estimates of the duration of joint motions."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import load_unit
from plan.trajectory.time_estimates import path_time, path_times, straight_time, straight_times

UNIT = load_unit("crs93")

LIMITS = UNIT.limits().scaled(0.5)


def test_travel_times_are_those_of_the_slowest_joint() -> None:
    """Against a trapezoid integrated joint by joint, for long and short moves."""
    rng = np.random.default_rng(1)
    for size in (1.0, 0.3, 0.01):
        for _ in range(50):
            step = rng.uniform(-size, size, 6)
            needed = 0.0
            for way, v, a in zip(np.abs(step), LIMITS.velocity, LIMITS.acceleration, strict=True):
                needed = max(needed, way / v + v / a if way > v * v / a else 2 * np.sqrt(way / a))
            # all joints in step can be no faster than the slowest alone
            assert straight_time(step, LIMITS) >= needed - 1e-12
    one = np.array([0.7, 0.0, 0.0, 0.0, 0.0, 0.0])
    v, a = LIMITS.velocity[0], LIMITS.acceleration[0]
    assert straight_time(one, LIMITS) == pytest.approx(0.7 / v + v / a)
    assert path_time(np.stack([0.0 * one, one]), LIMITS) == pytest.approx(0.7 / v + v / a)
    assert straight_time(0.0 * one, LIMITS) == 0.0


def test_times_between_all_are_times_of_each() -> None:
    rng = np.random.default_rng(3)
    starts, ends = rng.uniform(-1.0, 1.0, (5, 6)), rng.uniform(-1.0, 1.0, (7, 6))
    ends[2] = starts[3]  # one that takes no time
    times = straight_times(starts, ends, LIMITS)
    assert np.allclose(times, straight_time(ends[None] - starts[:, None], LIMITS))
    assert times[3, 2] == 0.0


def test_times_of_many_paths_are_times_of_each() -> None:
    rng = np.random.default_rng(2)
    paths = rng.uniform(-1.0, 1.0, (20, 4, 6))
    assert np.allclose(path_times(paths, LIMITS), [path_time(p, LIMITS) for p in paths])
