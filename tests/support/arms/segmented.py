"""Random motions in integer segments, and their limits."""

from __future__ import annotations

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Limits, Unit
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.integer_segments import (
    SHORTEST_MS,
)
from plan.trajectory.rounding import VERTEX_S


def time_limits(limits: Limits) -> Limits:
    """The default fractions of speed and acceleration."""
    return Limits(limits.lower, limits.upper, limits.velocity * 0.9, limits.acceleration * 0.5)


def check_limits(path: CountPath, unit: Unit, limits: Limits) -> None:
    worst = segment_extremes(path, unit)
    assert (worst.velocity / limits.velocity).max() <= 1.0
    assert (worst.acceleration / limits.acceleration).max() <= 1.0
    one_count = 1.0 / np.abs(unit.counts_per_rad)
    assert (worst.lower >= limits.lower - one_count).all()
    assert (worst.upper <= limits.upper + one_count).all()
    # independent of `extremes`: every millisecond, by differences
    q = unit.positions(path.sample(1e-3))
    assert (np.abs(np.diff(q, axis=0)) * 1e3 / limits.velocity).max() <= 1.0 + 1e-9
    # the controller's vertex rule, or what rounding to counts per segment costs on both sides of a join
    rounding = 1.5 / (SHORTEST_MS / 1e3) / np.abs(unit.counts_per_rad)
    vertex = np.maximum(VERTEX_S * limits.acceleration, rounding)
    change = np.abs(np.diff(q, n=2, axis=0)) * 1e3
    assert (change <= limits.acceleration * 1e-3 + vertex).all()
    assert (worst.jumps <= vertex).all()


def check_chain(path: CountPath, unit: Unit, q_first: np.ndarray, q_last: np.ndarray) -> None:
    np.testing.assert_array_equal(path.start, unit.counts(q_first))
    np.testing.assert_array_equal(path.end, unit.counts(q_last))
    first, last = np.array(path.segments[0].coefficients), np.array(path.segments[-1].coefficients)
    np.testing.assert_array_equal(first[0], 0)  # at rest, exactly
    np.testing.assert_array_equal(last[0] + 2 * last[1] + 3 * last[2], 0)
    assert all(s.duration_ms >= SHORTEST_MS for s in path.segments)
    assert all(isinstance(c, int) for s in path.segments for row in s.coefficients for c in row)
    assert all(abs(c) < 2**31 for s in path.segments for row in s.coefficients for c in row)
