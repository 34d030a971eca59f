"""The derivatives of projected points, each against finite differences of the projection."""

import numpy as np
import pytest

from arm.se3 import moved, rotation, transform
from calib.model.intrinsics import COUNT, camera_of, vector_of
from pictures.targets import camera
from vision.camera.projection import Projection, along

H = 1e-6
TWISTS = np.eye(6)


@pytest.fixture(scope="module")
def seen():
    """Eight points at five poses, also near the border of the image."""
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.1, 0.1, (8, 2)), rng.uniform(-0.02, 0.02, 8)])
    T = np.array(
        [
            transform(
                rotation(rng.uniform(-0.6, 0.6, 3)), (*rng.uniform(-0.25, 0.25, 2), rng.uniform(0.7, 1.3))
            )
            for _ in range(5)
        ]
    )
    return Projection(camera(), T, points)


def slope(pixels):
    """Central difference of a function of a number."""
    return (pixels(H) - pixels(-H)) / (2.0 * H)


def test_points_are_projected_pose_by_pose(seen):
    for T, pixels, at in zip(seen.T, seen.pixels, seen.in_camera, strict=True):
        alone = Projection(seen.camera, T, seen.points)
        assert alone.in_camera == pytest.approx(seen.points @ T[:3, :3].T + T[:3, 3], abs=1e-15)
        assert at == pytest.approx(alone.in_camera, abs=1e-15)
        assert pixels == pytest.approx(seen.camera.project(alone.in_camera), abs=1e-9)
        assert alone.by_target.shape == (8, 2, 6)
        assert alone.by_intrinsics.shape == (8, 2, 9)


def test_by_the_twist_of_the_target(seen):
    for k, twist in enumerate(TWISTS):
        poses = lambda h, twist=twist: np.array([moved(T, h * twist) for T in seen.T])  # noqa: E731
        told = slope(lambda h, poses=poses: Projection(seen.camera, poses(h), seen.points).pixels)
        assert seen.by_target[..., k] == pytest.approx(told, rel=1e-6, abs=1e-5)


def test_by_a_twist_in_the_camera_frame(seen):
    for k, twist in enumerate(TWISTS):
        poses = lambda h, twist=twist: moved(np.eye(4), h * twist) @ seen.T  # noqa: E731
        told = slope(lambda h, poses=poses: Projection(seen.camera, poses(h), seen.points).pixels)
        assert seen.by_camera[..., k] == pytest.approx(told, rel=1e-6, abs=1e-5)


def test_by_the_points(seen):
    for k, step in enumerate(np.eye(3)):
        told = slope(lambda h, step=step: Projection(seen.camera, seen.T, seen.points + h * step).pixels)
        assert seen.by_point[..., k] == pytest.approx(told, rel=1e-6, abs=1e-5)
        of_camera = slope(lambda h, step=step: seen.camera.project(seen.in_camera + h * step))
        assert seen.by_camera_point[..., k] == pytest.approx(of_camera, rel=1e-6, abs=1e-5)


def test_by_the_intrinsics(seen):
    vector = vector_of(seen.camera)
    for k, unit in enumerate(np.eye(COUNT)):
        step = max(1.0, abs(vector[k])) * unit
        told = slope(
            lambda h, step=step: camera_of(vector + h * step, seen.camera.size).project(seen.in_camera)
        )
        assert seen.by_intrinsics[..., k] * step[k] == pytest.approx(told, rel=1e-6, abs=1e-5)


def test_along_unknowns_that_move_the_target(seen):
    twists = np.random.default_rng(2).standard_normal((5, 3, 6))
    told = along(seen.by_target, twists)
    for k in range(3):
        poses = lambda h, k=k: np.array([moved(T, h * t[k]) for T, t in zip(seen.T, twists, strict=True)])  # noqa: E731
        expected = slope(lambda h, poses=poses: Projection(seen.camera, poses(h), seen.points).pixels)
        assert told[..., k] == pytest.approx(expected, rel=1e-5, abs=1e-4)
