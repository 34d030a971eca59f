"""Jerk-limited timing: limits of three orders everywhere, exactly on the path, rest where acceleration would jump."""

from __future__ import annotations

import numpy as np
import pytest
import ruckig
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits, load_unit
from arm.errors import InputError
from plan.cartesian.line import JointPath
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.integer_segments import to_marked_segments, to_segments
from plan.trajectory.jerk_limited import JerkTrajectory, time_smooth
from plan.trajectory.joint_path import polyline
from plan.trajectory.timing import time_curve, time_path
from plans.joined_lines import joined

LIMITS = load_unit("crs97").limits()
JERK = 8.0 * LIMITS.acceleration


def _check(timed: JerkTrajectory, limits: Limits, jerk: np.ndarray) -> None:
    t = np.linspace(0.0, timed.duration, 6007)
    state, third = timed.at(t), timed.jerks(t)
    assert (np.abs(state.qd) / limits.velocity).max() <= 1.0 + 1e-9
    assert (np.abs(state.qdd) / limits.acceleration).max() <= 1.0 + 1e-9
    assert (np.abs(third) / jerk).max() <= 1.0 + 1e-9
    # rest at both ends, and derivatives that belong to the positions: acceleration never jumps
    np.testing.assert_allclose(state.qd[[0, -1]], 0.0, atol=1e-9)
    np.testing.assert_allclose(state.qdd[[0, -1]], 0.0, atol=1e-6)
    h = t[1] - t[0]
    assert (np.abs(np.diff(state.q, axis=0) / h - (state.qd[1:] + state.qd[:-1]) / 2) <= jerk * h**2).all()
    assert (
        np.abs(np.diff(state.qd, axis=0) / h - (state.qdd[1:] + state.qdd[:-1]) / 2) <= 2 * jerk * h
    ).all()
    assert (np.abs(np.diff(state.qdd, axis=0)) <= jerk * h * (1 + 1e-6) + 1e-9).all()


def test_straight_moves_stay_straight_and_are_as_fast_as_all_joints_in_phase() -> None:
    rng = np.random.default_rng(1)
    for k in range(40):
        q = rng.uniform(LIMITS.lower, LIMITS.upper, (2, 6))
        if k % 2:
            q[1] = q[0] + 1e-3 * (q[1] - q[0])
        timed = time_smooth(polyline(q), LIMITS, JERK)
        assert timed.method == "ruckig"
        _check(timed, LIMITS, JERK)
        curve, step = timed.at(np.linspace(0, timed.duration, 500)).q - q[0], q[1] - q[0]
        along = curve @ step / (step @ step)
        np.testing.assert_allclose(curve, along[:, None] * step, atol=1e-12)
        given, found = ruckig.InputParameter(6), ruckig.Trajectory(6)
        given.current_position, given.target_position = q.tolist()
        given.max_velocity, given.max_acceleration = LIMITS.velocity.tolist(), LIMITS.acceleration.tolist()
        given.max_jerk = JERK.tolist()
        given.synchronization = ruckig.Synchronization.Phase
        ruckig.Ruckig(6).calculate(given, found)
        # Ruckig falls back on keeping time alone where phase needs longer; then it leaves the line
        assert timed.duration >= found.duration * (1 - 1e-9)
        middle = np.array(found.at_time(0.3 * found.duration)[0]) - q[0]
        if np.abs(middle - (middle @ step) / (step @ step) * step).max() < 1e-9:
            assert timed.duration == pytest.approx(found.duration, rel=1e-6)
        assert timed.duration > time_path(q, LIMITS).duration


def test_without_a_jerk_limit_to_speak_of_it_is_the_trapezoid() -> None:
    q = np.array([np.zeros(6), np.full(6, 0.7)])
    timed = time_smooth(polyline(q), LIMITS, 1e4 * JERK)
    assert timed.duration == pytest.approx(time_path(q, LIMITS).duration, rel=1e-3)


def _leg() -> tuple[JointPath, np.ndarray, JointPath]:
    rng, s = np.random.default_rng(3), np.linspace(0.0, 0.1, 51)
    q = rng.uniform(-1.0, 1.0, (3, 6))
    first, last = (
        rng.uniform(-3, 3, 6) * s[:, None] + rng.uniform(-9, 9, 6) * s[:, None] ** 2 for _ in range(2)
    )
    return JointPath(q[0] + first - first[-1], s), q, JointPath(q[-1] + last, s)


def test_a_joined_motion_keeps_jerk_and_rests_where_blends_begin() -> None:
    before, q, after = _leg()
    leg = joined(before, q, after, LIMITS, 0.1, blend=0.01)
    timed = time_smooth(leg.path, LIMITS, JERK, leg.caps)
    assert isinstance(timed, JerkTrajectory)
    _check(timed, LIMITS, JERK)
    at_marks = timed.at(timed.passed(leg.edges[1:-1]))
    np.testing.assert_allclose(at_marks.q, leg.path(leg.edges[1:-1]), atol=1e-8)
    np.testing.assert_allclose(at_marks.qd, 0.0, atol=1e-4)
    pieces = np.clip(np.searchsorted(leg.path.x, timed.s, side="right") - 1, 0, len(leg.caps) - 1)
    assert (timed.rate <= leg.caps[pieces] * (1 + 1e-9)).all()
    stops = (
        sum(time_curve(line.spline, LIMITS, 0.1).duration for line in (before, after))
        + time_path(q, LIMITS).duration
    )
    assert time_curve(leg.path, LIMITS, leg.caps).duration < timed.duration < 1.5 * stops
    # and it can be sent
    unit = load_unit("crs97")
    marked = to_marked_segments(timed, unit, limits=LIMITS, marks=leg.edges[1:-1])
    worst = segment_extremes(marked.path, unit)
    assert (worst.velocity / LIMITS.velocity).max() <= 1.0
    assert (worst.acceleration / LIMITS.acceleration).max() <= 1.0
    assert marked.path.duration_s < 1.01 * timed.duration


def test_curves_keep_jerk_without_stops() -> None:
    rng, s = np.random.default_rng(4), np.linspace(0.0, 1.0, 41)
    for _ in range(10):
        q = 0.5 * np.sin(np.outer(s, rng.uniform(1, 6, 6)) + rng.uniform(0, 6, 6))
        timed = time_smooth(CubicSpline(s, q), LIMITS, JERK)
        _check(timed, LIMITS, JERK)
        assert (timed.rate[1:-1] > 0.0).all()
        half = timed.under(LIMITS.scaled(0.5))
        assert half.duration > timed.duration
        path = to_segments(timed.stretched(1.001), load_unit("crs97"), limits=LIMITS)
        assert path.duration_s < 1.02 * timed.duration


def test_a_jerk_limit_must_be_positive() -> None:
    with pytest.raises(InputError, match="jerk limit = 0: must be positive"):
        time_smooth(polyline(np.eye(6)[:2]), LIMITS, 0.0)
