"""A camera's pose from a tape: it looks at its point, with the image's right side where it is said to be."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import inverse, rot_x, rot_z, transform
from vision.camera.taped_pose import looking_pose


def test_straight_down_it_is_the_rotation_that_a_person_would_write() -> None:
    right = np.radians(70.0)
    position = np.array([0.49, -0.01, 1.19])
    wanted = transform(rot_z(right) @ rot_x(np.pi), position)
    assert np.allclose(looking_pose(position, position * [1, 1, 0], right), wanted, atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_the_point_is_on_the_line_of_sight_and_right_is_right(seed: int) -> None:
    rng = np.random.default_rng(seed)
    position, point, right = rng.uniform(-2, 2, 3), rng.uniform(-2, 2, 3), rng.uniform(-np.pi, np.pi)
    T = looking_pose(position, point, right)
    assert np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)
    assert np.allclose(T[:3, 3], position)
    seen = inverse(T) @ [*point, 1.0]
    assert np.allclose(seen[:2], 0.0, atol=1e-12)
    assert seen[2] == pytest.approx(np.linalg.norm(point - position))
    side = T[:3, :3].T @ [np.cos(right), np.sin(right), 0.0]  # in the camera's frame
    assert side[0] > 0.0
    assert side[1] == pytest.approx(0.0, abs=1e-12)


def test_no_direction_is_refused() -> None:
    with pytest.raises(InputError, match="own position"):
        looking_pose(np.ones(3), np.ones(3), 0.0)
    with pytest.raises(InputError, match="line of sight"):
        looking_pose(np.zeros(3), np.array([0.0, 2.0, 0.0]), np.pi / 2)
