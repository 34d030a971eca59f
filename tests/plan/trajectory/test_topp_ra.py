"""Own TOPP-RA: limits everywhere, never slower than toppra, exact where a closed form is known."""

from __future__ import annotations

import logging
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits, load_unit
from arm.errors import InputError
from arms.blended_paths import blended
from plan.trajectory.joint_path import Path, polyline
from plan.trajectory.time_estimates import straight_time
from plan.trajectory.timing import GRID, rate_caps, time_curve, time_path
from plan.trajectory.topp_ra import gridpoints, parametrise


def _paths(seed: int, count: int, limits: Limits) -> list[Path]:
    """Random splines of few and of many knots, and blended polylines."""
    rng, paths = np.random.default_rng(seed), []
    for k in range(count):
        q = rng.uniform(limits.lower, limits.upper, (rng.integers(3, 8), 6))
        if k % 5 == 0:
            q[:, rng.integers(0, 6)] = 0.3  # a joint that stands still
        if k % 2:
            paths.append(blended(q, rng.choice([0.003, 0.03, 0.3])))
        else:
            spline = CubicSpline(np.arange(len(q)) * rng.uniform(0.1, 10.0), q)
            x = np.linspace(spline.x[0], spline.x[-1], 40)
            paths.append(spline if k % 4 else CubicSpline(x, spline(x)))
    return paths


def test_limits_hold_at_every_instant() -> None:
    for name in ("crs93", "crs97"):
        limits = load_unit(name).limits()
        for path in _paths(1, 60, limits):
            timed = time_curve(path, limits)
            # between knots too, and on both sides of each
            t = np.sort(
                np.concatenate([np.linspace(0, timed.duration, 4001), timed.times, timed.times + 1e-9])
            )
            state = timed.at(t)
            assert (np.abs(state.qd) / limits.velocity).max() <= 1.0 + 1e-9
            assert (np.abs(state.qdd) / limits.acceleration).max() <= 1.0 + 1e-9
            np.testing.assert_allclose(state.qd[[0, -1]], 0.0, atol=1e-7)
            assert timed.stretch < 1.0005


def test_no_two_grid_points_coincide() -> None:
    """Pieces as short as the resolution of the path parameter, and switches near their ends."""
    limits = Limits(np.full(2, -9.0), np.full(2, 9.0), np.array([1.0, 2.0]), np.array([2.0, 3.0]))
    for seed in range(800):
        rng = np.random.default_rng(seed)
        cuts = np.sort(rng.uniform(0.0, 5.0, 3))
        x = np.sort(np.concatenate([[0.0], cuts, cuts + 10.0 ** rng.uniform(-14.0, -7.0), [5.0]]))
        path = polyline(x[:, None] * np.array([1.0, rng.uniform(-0.5, 0.5)]))
        one = np.ones(len(path.x) - 1, dtype=np.int64)
        s, rate = parametrise(gridpoints(path, one, rate_caps(path, rng.uniform(0.05, 2.0))), limits)
        assert (np.diff(s) > 0.0).all(), seed
        assert np.isfinite(rate).all(), seed


def _toppra_time(path: Path, limits: Limits, intervals: int) -> float:
    with warnings.catch_warnings():
        for category in (DeprecationWarning, SyntaxWarning):
            warnings.simplefilter("ignore", category)
        from toppra import algorithm, constraint
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    slope = np.abs(path(np.linspace(path.x[0], path.x[-1], 999), 1)).max(axis=0)
    unit = 1.0 / float((slope / limits.velocity).max())

    class Scaled:
        """Its tolerances are absolute: a parameter whose rate is near 1."""

        dof, waypoints = 6, None
        path_interval = np.array([path.x[0], path.x[-1]]) / unit

        def __call__(self, s: np.ndarray, order: int = 0) -> np.ndarray:
            return np.asarray(path(np.asarray(s) * unit, order) * unit**order)

        def eval(self, s: np.ndarray) -> np.ndarray:
            return self(s)

        def evald(self, s: np.ndarray) -> np.ndarray:
            return self(s, 1)

        def evaldd(self, s: np.ndarray) -> np.ndarray:
            return self(s, 2)

    grid = np.unique(
        np.concatenate([np.linspace(path.x[0], path.x[-1], intervals + 1), path.x, path.x + 1e-6])
    )
    grid = grid[grid <= path.x[-1]]
    velocity, acceleration = (
        np.column_stack([-most, most]) for most in (limits.velocity, limits.acceleration)
    )
    solver = algorithm.TOPPRA(
        [
            constraint.JointVelocityConstraint(velocity),
            constraint.JointAccelerationConstraint(
                acceleration, discretization_scheme=constraint.DiscretizationType.Interpolation
            ),
        ],
        Scaled(),
        gridpoints=grid / unit,
        solver_wrapper="seidel",
    )
    with np.errstate(all="ignore"):
        _, rate, _ = solver.compute_parameterization(0.0, 0.0)
    if rate is None:
        return float("inf")
    return float((2 * np.diff(grid / unit) / np.maximum(rate[:-1] + rate[1:], 1e-9)).sum())


def test_never_slower_than_toppra() -> None:
    """toppra without the stretching that it needs to keep limits, and on 800 intervals where corners are round."""
    ratios = []
    for name in ("crs93", "crs97"):
        limits = load_unit(name).limits()
        for path in _paths(2, 15, limits):
            intervals = GRID if len(path.c) == 4 else 4 * GRID
            ratios.append(time_curve(path, limits).duration / _toppra_time(path, limits, intervals))
    assert max(ratios) <= 1.005
    assert np.quantile(ratios, 0.9) <= 1.002
    answered = [ratio for ratio in ratios if ratio > 0.0]
    assert len(answered) > 0.9 * len(ratios)
    assert np.median(answered) > 0.995  # nor faster than can be: theirs is right too


def test_straight_lines_take_what_a_trapezoid_takes() -> None:
    limits, rng = load_unit("crs97").limits(), np.random.default_rng(3)
    for k in range(60):
        q = rng.uniform(limits.lower, limits.upper, (2, 6))
        if k % 2:
            q[1] = q[0] + 1e-3 * (q[1] - q[0])
        exact = float(straight_time(q[1] - q[0], limits))
        assert time_curve(polyline(q), limits).duration == pytest.approx(exact, rel=1e-9)
        assert time_path(q, limits).duration == pytest.approx(exact, rel=1e-9)
        # as a curve that happens to be straight, on a grid
        s = np.linspace(0, 1, 30)[:, None]
        spline = CubicSpline(s[:, 0], q[0] + (s + 0.02 * np.sin(3 * s)) * (q[1] - q[0]))
        curve = float(straight_time(spline(1.0) - spline(0.0), limits))
        assert time_curve(spline, limits).duration == pytest.approx(curve, rel=1e-3)
        assert time_curve(spline, limits).duration >= curve * (1 - 1e-9)


def test_higher_limits_are_never_slower_and_scale() -> None:
    limits, rng = load_unit("crs93").limits(), np.random.default_rng(4)
    for path in _paths(5, 20, limits):
        base = time_curve(path, limits).duration
        half = Limits(limits.lower, limits.upper, limits.velocity * 0.5, limits.acceleration * 0.25)
        assert time_curve(path, half).duration == pytest.approx(2.0 * base, rel=1e-9)
        joint, more = rng.integers(0, 6), np.ones(6)
        more[joint] = rng.uniform(1.0, 2.0)
        # grid and easing leave a little noise
        assert time_curve(path, replace(limits, velocity=limits.velocity * more)).duration <= base * 1.0005
        assert (
            time_curve(path, replace(limits, acceleration=limits.acceleration * more)).duration
            <= base * 1.0005
        )


def test_caps_hold_in_their_piece_and_are_used() -> None:
    limits, rng = load_unit("crs97").limits(), np.random.default_rng(6)
    for path in _paths(7, 10, limits):
        free = time_curve(path, limits)
        caps = np.where(rng.random(len(path.x) - 1) < 0.5, 0.4 * free.rate.max(), np.inf)
        timed = time_curve(path, limits, caps)
        middle = (timed.s[:-1] + timed.s[1:]) / 2
        inside = np.clip(np.searchsorted(path.x, middle) - 1, 0, len(caps) - 1)
        assert (np.maximum(timed.rate[:-1], timed.rate[1:]) <= caps[inside] * (1 + 1e-9)).all()
        assert timed.duration >= free.duration * (1 - 1e-4)
        for begin, end in zip(timed.s[:-1], timed.s[1:], strict=True):
            assert not ((path.x > begin + 1e-12) & (path.x < end - 1e-12)).any()
    with pytest.raises(InputError, match="must be positive"):
        time_curve(path, limits, np.zeros(len(path.x) - 1))


def test_zero_inertia_and_cusps_are_passed() -> None:
    """A joint that turns back (q' = 0, q'' large) while another runs on; and a path that stands still in a point."""
    limits = load_unit("crs97").limits()
    s = np.linspace(-1, 1, 41)
    turning = np.zeros((41, 6))
    turning[:, 0], turning[:, 1], turning[:, 5] = s, 0.4 * s**2, s**3
    cusp = np.repeat((s**3)[:, None], 6, axis=1)
    for q in (turning, cusp):
        timed = time_curve(CubicSpline(s, q), limits)
        state = timed.at(np.linspace(0, timed.duration, 5001))
        assert (np.abs(state.qdd) / limits.acceleration).max() <= 1.0 + 1e-9
        if q is cusp:
            assert timed.duration < 1.5 * float(straight_time(q[-1] - q[0], limits))
            continue
        use = np.maximum(np.abs(state.qd) / limits.velocity, np.abs(state.qdd) / limits.acceleration).max(
            axis=1
        )
        assert (use > 0.95).mean() > 0.8


def test_a_path_without_length_is_refused() -> None:
    with pytest.raises(InputError, match="no joint moves"):
        time_curve(CubicSpline(np.arange(5), np.zeros((5, 6))), load_unit("crs97").limits())
