"""Geometry of joint paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Limits, Unit, load_unit
from arm.errors import InputError
from arms.blended_paths import blended
from plan.cartesian.line import JointPath
from plan.trajectory.joint_path import Chained, Stretch, chained, polyline
from plans.joined_lines import joined


def test_a_polyline_passes_its_points_with_unit_slope() -> None:
    q = np.random.default_rng(1).uniform(-2, 2, (5, 6))
    path = polyline(q)
    np.testing.assert_allclose(path(path.x), q, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(path(np.linspace(0, path.x[-1], 99), 1), axis=1), 1.0)


@pytest.mark.parametrize("deviation", [1e-4, 0.02, 10.0])
def test_blends_are_smooth_and_within_their_deviation(deviation: float) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        q = rng.uniform(-2, 2, (6, 6))
        path = blended(q, deviation)
        s = np.linspace(path.x[0], path.x[-1], 4001)
        curve = path(s)
        np.testing.assert_allclose(curve[[0, -1]], q[[0, -1]], atol=1e-14)
        inside = path.x[1:-1]
        np.testing.assert_allclose(path(inside - 1e-10), path(inside + 1e-10), atol=1e-9)
        np.testing.assert_allclose(path(inside - 1e-10, 1), path(inside + 1e-10, 1), atol=1e-6)
        assert _distance(curve, q).max() <= deviation + 1e-12
        nearest = np.linalg.norm(curve[:, None] - q[1:-1], axis=-1).min(axis=0)
        assert (nearest <= deviation + 5e-3).all()


def _distance(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    a, d = corners[:-1], np.diff(corners, axis=0)
    f = np.clip(((points[:, None] - a) * d).sum(-1) / (d * d).sum(-1), 0, 1)
    return np.linalg.norm(points[:, None] - (a + f[..., None] * d), axis=-1).min(axis=1)


def test_collinear_points_need_no_blend() -> None:
    q = np.linspace(0, 1, 5)[:, None] * np.ones(6)
    path = blended(q, 0.01)
    assert np.abs(path(np.linspace(0, path.x[-1], 50), 2)).max() < 1e-9


def test_a_single_point_is_not_a_path() -> None:
    with pytest.raises(InputError, match="two different way-points"):
        polyline(np.zeros((3, 6)))


def _line(rng: np.random.Generator, end: np.ndarray, away: bool) -> JointPath:
    """A smooth curve of joints that ends (`away`) or begins in `end`, over 0.1 m."""
    s = np.linspace(0.0, 0.1, 51)
    curve = rng.uniform(-3, 3, 6) * s[:, None] + rng.uniform(-9, 9, 6) * s[:, None] ** 2
    return JointPath(end + curve - curve[-1], s) if away else JointPath(end + curve, s)


def _legs(seed: int, count: int) -> list[tuple[JointPath | None, np.ndarray, JointPath | None]]:
    rng, legs = np.random.default_rng(seed), []
    for k in range(count):
        q = rng.uniform(-1.5, 1.5, (rng.integers(2, 6), 6)) * (1.0 if k % 3 else 0.01)
        before, after = _line(rng, q[0], True), _line(rng, q[-1], False)
        legs.append((before if k % 4 != 1 else None, q, after if k % 4 != 2 else None))
    return legs


def _smooth(result: Chained, limits: Limits) -> None:
    path = result.path
    inside = path.x[1:-1]
    # what the piece before each break ends with
    before = path(inside - 1e-9, 1) + 1e-9 * path(inside - 1e-9, 2)
    np.testing.assert_allclose(before, path(inside, 1), atol=1e-6 * limits.velocity.max())
    np.testing.assert_allclose(path(inside - 1e-9), path(inside), atol=1e-8)


@pytest.mark.parametrize("blend", [1.0, 0.3, 1e-3])
def test_joined_lines_are_kept_and_corners_are_smooth(blend: float) -> None:
    limits = load_unit("crs97").limits()
    for before, q, after in _legs(7, 60):
        result = joined(before, q, after, limits, 0.1, blend)
        path = result.path
        first = path.x[0] if before is None else result.edges[1]
        last = path.x[-1] if after is None else result.edges[-2]
        _smooth(result, limits)
        np.testing.assert_allclose(path(path.x[[0, -1]]), [
            q[0] if before is None else before.q[0], q[-1] if after is None else after.q[-1]
        ], atol=1e-9)  # fmt: skip
        u = np.linspace(0, 1, 200)
        if before is not None:  # the whole line, in proportion
            line = before.spline
            np.testing.assert_allclose(path(first * u), line(0.1 * u), atol=1e-9)
        if after is not None:
            line = after.spline
            np.testing.assert_allclose(path(last + (path.x[-1] - last) * u), line(0.1 * u), atol=1e-9)
        assert len(result.caps) == len(path.x) - 1
        inside = (path.x[:-1] >= first) & (path.x[1:] <= last)
        assert np.isinf(result.caps[inside]).all()
        assert np.isfinite(result.caps[~inside]).all()


def test_tau_is_the_time_of_full_speed_with_blends_at_the_acceleration_limit() -> None:
    limits = load_unit("crs97").limits()
    for before, q, after in _legs(8, 60):
        path = joined(before, q, after, limits).path
        tau = np.linspace(path.x[0], path.x[-1], 20001)
        speed = (np.abs(path(tau, 1)) / limits.velocity).max(axis=1)
        assert speed.max() <= 1.0 + 1e-9
        straight = np.flatnonzero((path.c[:-2] == 0.0).all(axis=(0, 2)))
        slope = (np.abs(path.c[-2][straight]) / limits.velocity).max(axis=1)
        np.testing.assert_allclose(slope, 1.0, rtol=1e-6)


def test_a_joined_polyline_without_lines_is_its_blends() -> None:
    """One right-angled corner by hand: both joints at v, blend of v / a, v t_b / (4 sqrt 2) off the corner."""
    limits = replace(load_unit("crs97").limits(), velocity=np.full(6, 0.5), acceleration=np.full(6, 2.0))
    q = np.zeros((3, 6))
    q[1:, 0], q[2, 1] = 1.0, 1.0
    result = joined(None, q, None, limits)
    np.testing.assert_allclose(result.path.x, [0.0, 1.875, 2.125, 4.0])
    assert _distance(result.path(np.array([2.0])), q) == pytest.approx(0.5 * 0.25 / 8, rel=1e-9)
    assert np.isinf(result.caps).all()


def test_parts_that_cannot_be_chained_are_refused() -> None:
    limits = load_unit("crs97").limits()
    before, q, after = _legs(9, 1)[0]
    with pytest.raises(InputError, match=r"line before: ends .* must meet"):
        joined(before, q + 0.1, after, limits)
    with pytest.raises(InputError, match="blend = 0: must be above 0"):
        joined(before, q, after, limits, blend=0.0)
    with pytest.raises(InputError, match="speed cap = -1: must be positive"):
        joined(before, q, after, limits, -1.0)
    with pytest.raises(InputError, match="two different way-points"):
        joined(None, q[[0, 0]], None, limits)


def test_a_chain_of_five_parts_is_smooth_and_keeps_its_lines(unit: Unit) -> None:
    """Line, way, line, way, line: smooth everywhere, lines kept."""
    limits = unit.limits()
    rng = np.random.default_rng(8)
    lines = []
    for _ in range(3):
        a, b = rng.uniform(-0.5, 0.5, (2, 6))
        s = np.linspace(0.0, 0.1, 9)
        lines.append(JointPath(a + (s / 0.1)[:, None] * (b - a) + 0.1 * np.sin(20 * s)[:, None], s))
    parts = [
        Stretch(lines[0], 0.05),
        np.stack([lines[0].q[-1], lines[1].q[0]]),
        Stretch(lines[1]),
        np.stack([lines[1].q[-1], rng.uniform(-0.5, 0.5, 6), lines[2].q[0]]),
        Stretch(lines[2], 0.08),
    ]
    chain = chained(parts, limits)
    assert len(chain.edges) == 6
    inner = chain.path.x[1:-1]
    for order in (0, 1):
        jump = np.abs(chain.path(inner - 1e-9, order) - chain.path(inner + 1e-9, order))
        assert jump.max() < 1e-6
    for line, begin, end in zip(lines, chain.edges[::2], chain.edges[1::2], strict=True):
        np.testing.assert_allclose(chain.path([begin, end]), line.q[[0, -1]], atol=1e-9)
    with pytest.raises(InputError, match="must alternate between lines and transits"):
        chained([parts[0], parts[2]], limits)
