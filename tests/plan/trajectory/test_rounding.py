"""Rounded to whole counts, every limit still holds."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arms.blended_paths import time_blended
from arms.segmented import check_chain, check_limits, time_limits
from plan.trajectory.integer_segments import (
    to_segments,
)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("speed", "seed", "moves"),
    [
        (1.0, 1, 24),
        (0.5, 1, 12),
        (0.1, 1, 8),
        pytest.param(1.0, 2, 60, marks=pytest.mark.slow),
        pytest.param(0.5, 2, 30, marks=pytest.mark.slow),
    ],
)
def test_random_moves_keep_every_limit(unit: Unit, speed: float, seed: int, moves: int) -> None:
    limits, rng = unit.limits().scaled(speed), np.random.default_rng(seed)
    for k in range(moves):
        q = rng.uniform(limits.lower, limits.upper, (2, 6))
        if k % 3 == 0:
            q[1] = np.clip(q[0] + rng.normal(0, 0.02, 6), limits.lower, limits.upper)  # short moves too
        trajectory = time_blended(q, time_limits(limits))
        path = to_segments(trajectory, unit, limits=limits)
        check_chain(path, unit, q[0], q[1])
        check_limits(path, unit, limits)
        t = np.arange(0.0, path.duration_s, 0.003)
        planned = trajectory.stretched(path.duration_s / trajectory.duration).at(t).q
        off = np.abs(unit.positions(path.at(t)) - planned)
        assert (
            off <= 2.2e-4 + 2.0 / np.abs(unit.counts_per_rad)
        ).all() or path.duration_s > 1.01 * trajectory.duration
        assert path.duration_s < 1.05 * trajectory.duration + 0.1


def test_bends_keep_every_limit(unit: Unit) -> None:
    limits, rng = unit.limits(), np.random.default_rng(2)
    for _ in range(8):
        q = rng.uniform(limits.lower, limits.upper, (4, 6))
        path = to_segments(time_blended(q, time_limits(limits), blend=0.05), unit, limits=limits)
        check_chain(path, unit, q[0], q[-1])
        check_limits(path, unit, limits)


def test_limits_hold_without_room_for_rounding(unit: Unit) -> None:
    limits, rng = unit.limits().scaled(0.5), np.random.default_rng(3)
    for _ in range(10):
        q = rng.uniform(limits.lower, limits.upper, (3, 6))
        trajectory = time_blended(q, limits, blend=0.05)
        path = to_segments(trajectory, unit)
        check_limits(path, unit, limits)
        assert path.duration_s < 1.12 * trajectory.duration
