"""Lens distortion: its derivative by differences, and its inverse."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pictures.boards import lab_camera
from vision.camera.model import Camera


def points_in_view(count: int = 200) -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.uniform((-0.25, -0.15, 0.8), (0.2, 0.16, 1.3), (count, 3))


def skewed() -> Camera:
    """Skew and tangential distortion that the lab's camera hardly has."""
    camera = lab_camera()
    K = camera.K.copy()
    K[0, 1] = 3.0
    return replace(camera, K=K, distortion=np.array([-0.2, 0.1, 0.03, -0.02, 0.5]))


@pytest.mark.parametrize("camera", [lab_camera(), skewed()], ids=["lab", "skew"])
def test_derivative_by_differences(camera: Camera) -> None:
    points, h = points_in_view(30), 1e-6
    J = camera.projection_jacobian(points)
    for axis in range(3):
        step = h * np.eye(3)[axis]
        difference = (camera.project(points + step) - camera.project(points - step)) / (2 * h)
        assert np.abs(J[..., axis] - difference).max() < 1e-6 * np.abs(difference).max()


@pytest.mark.parametrize("camera", [lab_camera(), skewed()], ids=["lab", "skew"])
def test_normalised_undoes_the_lens_everywhere_in_the_image(camera: Camera) -> None:
    u, v = np.meshgrid(np.linspace(0, 1919, 23), np.linspace(0, 1199, 17))
    pixels = np.stack([u, v], axis=-1)
    points = camera.normalised(pixels)
    back = camera.project(np.concatenate([points, np.ones((17, 23, 1))], axis=-1))
    assert points.shape == (17, 23, 2)
    assert np.abs(back - pixels).max() < 1e-8
