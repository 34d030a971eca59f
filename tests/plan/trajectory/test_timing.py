"""Timing: limits at every instant, rest at both ends, no time wasted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import plan.trajectory.timing
import plan.trajectory.topp_ra
from arm.controller.unit import Limits, Unit
from arm.errors import InputError
from arms.blended_paths import time_blended
from plan.cartesian.line import JointPath
from plan.trajectory.timing import Trajectory, time_curve, time_path


def _check(trajectory: Trajectory, q_first: np.ndarray, q_last: np.ndarray, limits: Limits) -> None:
    """Rest at both ends, limits on a dense grid, and derivatives that belong to the positions."""
    t = np.linspace(0.0, trajectory.duration, 5003)
    state = trajectory.at(t)
    np.testing.assert_allclose(state.q[[0, -1]], [q_first, q_last], atol=1e-9)
    np.testing.assert_allclose(state.qd[[0, -1]], 0.0, atol=1e-9)
    assert (np.abs(state.qd) / limits.velocity).max() <= 1.0 + 1e-9
    assert (np.abs(state.qdd) / limits.acceleration).max() <= 1.0 + 1e-6
    step = 1e-6
    slope = (trajectory.at(t[1:-1] + step).q - trajectory.at(t[1:-1] - step).q) / (2 * step)
    np.testing.assert_allclose(slope, state.qd[1:-1], atol=2 * step * limits.acceleration.max())


def _curve(rng: np.random.Generator, limits: Limits) -> JointPath:
    """A smooth random path inside limits, s in 0..0.1."""
    s = np.linspace(0.0, 0.1, 51)
    middle, half = (limits.lower + limits.upper) / 2, (limits.upper - limits.lower) / 2
    phase, waves = rng.uniform(0, 2 * np.pi, 6), rng.uniform(5.0, 40.0, 6)
    return JointPath(middle + 0.3 * half * np.sin(np.outer(s, waves) + phase), s)


def test_straight_moves_keep_limits_and_use_them(unit: Unit) -> None:
    limits, rng = unit.limits(), np.random.default_rng(1)
    for _ in range(50):
        q = rng.uniform(limits.lower, limits.upper, (2, 6))
        trajectory = time_path(q, limits)
        assert trajectory.method == "trapezoid"
        _check(trajectory, q[0], q[1], limits)
        assert max(load.max() for load in trajectory.loads()) == pytest.approx(1.0)
        # the slowest joint alone could not be faster
        d, v, a = np.abs(q[1] - q[0]), limits.velocity, limits.acceleration
        alone = np.where(d > v**2 / a, d / v + v / a, 2 * np.sqrt(d / a))
        assert alone.max() * (1 - 1e-12) <= trajectory.duration <= 1.2 * alone.max()


def test_curves_keep_limits_and_use_them(unit: Unit) -> None:
    limits, rng = unit.limits(), np.random.default_rng(2)
    for _ in range(15):
        path = _curve(rng, limits)
        trajectory = time_curve(path.spline, limits)
        assert trajectory.method == "topp"
        _check(trajectory, path.q[0], path.q[-1], limits)
        assert trajectory.stretch < 1.02
        # time-optimal: some joint is at a limit nearly always
        state = trajectory.at(np.linspace(0, trajectory.duration, 500))
        use = np.maximum(np.abs(state.qd) / limits.velocity, np.abs(state.qdd) / limits.acceleration).max(
            axis=1
        )
        assert (use > 0.95).mean() > 0.9


def test_corners_blended_or_stopped_at(unit: Unit) -> None:
    limits, rng = unit.limits(), np.random.default_rng(3)
    for _ in range(8):
        q = rng.uniform(limits.lower, limits.upper, (4, 6))
        stopped, passed = time_path(q, limits), time_blended(q, limits, blend=0.05)
        _check(stopped, q[0], q[-1], limits)
        _check(passed, q[0], q[-1], limits)
        assert passed.stretch < 1.02
        at_corner = np.abs(stopped.at(np.linspace(0, stopped.duration, 4001)).q[:, None] - q).max(-1).min(0)
        assert at_corner.max() < 2e-3
        assert passed.duration < stopped.duration * 1.02


def test_a_tool_speed_cap_holds_and_is_used(unit: Unit) -> None:
    limits, rng = unit.limits(), np.random.default_rng(4)
    for _ in range(8):
        path = _curve(rng, limits)
        free = time_curve(path.spline, limits)
        cap = 0.3 * free.rate.max()
        capped = time_curve(path.spline, limits, rate_cap=cap)
        assert capped.rate.max() <= cap * (1 + 1e-9)
        assert capped.rate.max() > 0.99 * cap
        _check(capped, path.q[0], path.q[-1], limits)
    with pytest.raises(InputError, match="must be positive"):
        time_curve(path.spline, limits, rate_cap=0.0)


def test_speed_scales_time_alone(unit: Unit) -> None:
    path = _curve(np.random.default_rng(5), unit.limits())
    whole, half = time_curve(path.spline, unit.limits()), time_curve(path.spline, unit.limits().scaled(0.5))
    assert half.duration == pytest.approx(2 * whole.duration, rel=1e-3)


def test_a_solver_that_lies_costs_time_not_limits(crs97: Unit, monkeypatch: pytest.MonkeyPatch) -> None:
    limits, path = crs97.limits(), _curve(np.random.default_rng(6), crs97.limits())
    best = time_curve(path.spline, limits).duration

    def too_fast(*given, **named):  # type: ignore[no-untyped-def]
        s, rate = plan.trajectory.topp_ra.parametrise(*given, **named)
        return s, 1.3 * rate

    monkeypatch.setattr(plan.trajectory.timing, "parametrise", too_fast)
    trajectory = time_curve(path.spline, limits)
    _check(trajectory, path.q[0], path.q[-1], limits)
    assert trajectory.stretch > 1.0
    assert trajectory.duration >= best * (1 - 1e-9)


def test_a_spline_with_many_knots_is_timed_as_finely_as_it_bends(
    unit: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a way along a wire: the joints weave between 200 knots, most of all where these are dense."""
    limits = unit.limits()
    s = np.unique(np.concatenate([np.linspace(0.0, 1.0, 60), np.linspace(0.4, 0.5, 140)]))
    weave = np.sin(2.0 * np.pi * np.where(np.abs(s - 0.45) < 0.05, 60.0, 6.0) * s)
    q = (
        (limits.lower + limits.upper) / 2.0
        + np.outer(s, 0.3 * limits.upper)
        + np.outer(weave, np.full(6, 0.02))
    )
    path = CubicSpline(s, q)
    found = time_curve(path, limits).duration
    monkeypatch.setattr(plan.trajectory.timing._counts, "__defaults__", (40,))
    assert found < 1.025 * time_curve(path, limits).duration
