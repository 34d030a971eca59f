"""Axioms of SO(3) and SE(3) at random elements, near zero and near half a turn."""

import numpy as np
import pytest

from arm import se3
from arm.errors import A465Error


def _vectors(seed: int, count: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(count, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.concatenate(
        [rng.uniform(0, np.pi, count - 6), [0, 1e-10, 1e-7, np.pi - 1e-7, np.pi - 1e-12, 1.0]]
    )
    return axis * angle[:, None]


def test_logarithm_inverts_exponential() -> None:
    for w in _vectors(1, 300):
        R = se3.rotation(w)
        assert np.abs(R @ R.T - np.eye(3)).max() < 1e-12
        assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-12)
        assert np.abs(se3.rotation(se3.rotation_vector(R)) - R).max() < 1e-7


def test_rotation_vector_of_a_quarter_turn_about_each_axis() -> None:
    for turn, axis in ((se3.rot_x, 0), (se3.rot_y, 1), (se3.rot_z, 2)):
        v = se3.rotation_vector(turn(np.pi / 2))
        assert v == pytest.approx(np.eye(3)[axis] * np.pi / 2, abs=1e-12)


def test_inverse_and_apply() -> None:
    rng = np.random.default_rng(2)
    for w in _vectors(3, 50):
        T = se3.transform(se3.rotation(w), rng.normal(size=3))
        points = rng.normal(size=(7, 3))
        assert np.abs(se3.apply(se3.inverse(T), se3.apply(T, points)) - points).max() < 1e-12
        assert np.abs(T @ se3.inverse(T) - np.eye(4)).max() < 1e-12


def test_angle_between_is_the_angle_turned() -> None:
    R = se3.rotation((0.3, -0.2, 0.5))
    assert se3.angle_between(R, R @ se3.rot_z(0.25)) == pytest.approx(0.25, abs=1e-12)


def test_transforms_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        se3.transform()[0, 0] = 2.0


def test_printed_transform_is_orthonormalised_and_a_bad_one_refused() -> None:
    T = se3.transform(se3.rotation((1.0, 0.4, -0.2)), (0.1, 0.2, 0.3))
    again = se3.orthonormalised(np.round(T, 5))
    assert np.abs(again[:3, :3] @ again[:3, :3].T - np.eye(3)).max() < 1e-14
    assert np.abs(again - T).max() < 2e-5
    mirrored = np.array(T)
    mirrored[:, 0] *= -1
    for bad in (np.array(T) * 1.01, mirrored, np.full((4, 4), np.nan), np.eye(3)):
        with pytest.raises(A465Error):
            se3.orthonormalised(bad)
