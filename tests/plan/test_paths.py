"""Geometry of joint paths."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from plan.paths import blended, polyline, smooth_path


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


def test_a_spline_passes_its_points() -> None:
    s = np.linspace(0, 0.1, 30)
    q = np.sin(np.outer(s, np.arange(1, 7)) * 10)
    np.testing.assert_allclose(smooth_path(q, s)(s), q, atol=1e-14)


def test_one_place_is_not_a_path() -> None:
    with pytest.raises(InputError, match="two different way-points"):
        polyline(np.zeros((3, 6)))
    with pytest.raises(InputError, match="must be positive"):
        blended(np.eye(6), 0.0)
