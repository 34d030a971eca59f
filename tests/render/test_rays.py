"""Rays of a camera: the lens undone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import transform
from render.rays import pixel_rays, smooth_displacement, subpixel_rays
from vision.camera.model import Camera


def test_pixel_rays_project_back_to_their_pixels(camera: Camera) -> None:
    rays = pixel_rays(camera)
    points = np.stack([rays.x, rays.y, np.ones_like(rays.x)], axis=-1).astype(float)[::7, ::7]
    u, v = np.meshgrid(np.arange(0, 1920, 7), np.arange(0, 1200, 7))
    error = camera.project(points) - np.stack([u, v], axis=-1)
    assert np.abs(error).max() < 2e-4


def test_rays_follow_the_lens_alone_and_nobody_changes_them(camera: Camera, small: Camera) -> None:
    rays, moved = pixel_rays(small), pixel_rays(small.at(transform(t=(0.1, 0.2, 0.3))))
    assert np.array_equal(rays.x, moved.x)
    with pytest.raises(ValueError, match="read-only"):
        rays.y[0, 0] = 0.0
    bent = small.distortion + (0.01, 0.0, 0.0, 0.0, 0.0)
    for other in (
        camera,
        replace(small, distortion=bent),
        replace(small, K=small.K + np.diag([1.0, 0.0, 0.0])),
    ):
        assert not np.array_equal(pixel_rays(other).x, rays.x)


def test_rays_inside_pixels_are_where_the_lens_puts_them(camera: Camera) -> None:
    rng = np.random.default_rng(0)
    row = np.append(rng.integers(0, 1200, 500), [0, 0, 1199, 1199])
    column = np.append(rng.integers(0, 1920, 500), [0, 1919, 0, 1919])
    moved = subpixel_rays(pixel_rays(camera), row, column).moved(0.46, -0.41)
    pixels = camera.project(np.stack([moved.x, moved.y, np.ones_like(moved.x)], axis=-1))
    assert np.abs(pixels - np.stack([column + 0.46, row - 0.41], axis=-1)).max() < 5e-4


def test_displaced_points_of_the_image_are_seen_where_they_were_moved_to(small: Camera) -> None:
    shift = np.array([0.7, -0.4])
    moved = np.broadcast_to(shift, smooth_displacement(small.size, np.random.default_rng(0), 1.0).shape)
    rays = pixel_rays(small, moved)
    points = np.stack([rays.x, rays.y, np.ones_like(rays.x)], axis=-1).astype(float)[::7, ::7]
    u, v = np.meshgrid(np.arange(0, 240, 7), np.arange(0, 150, 7))
    assert np.abs(small.project(points) + shift - np.stack([u, v], axis=-1)).max() < 2e-3


def test_a_displacement_has_the_stated_strength_everywhere() -> None:
    rng = np.random.default_rng(3)
    drawn = np.array([smooth_displacement((640, 480), rng, 0.05) for _ in range(80)])
    assert abs(drawn.std() / 0.05 - 1.0) < 0.03
    assert drawn.std(axis=0).min() / 0.05 > 0.6
    assert drawn.std(axis=0).max() / 0.05 < 1.4
    near, far = (np.mean(drawn[:, 5, 5] * drawn[:, 5, 5 + k]) / 0.05**2 for k in (1, 8))
    assert near > 0.7
    assert abs(far) < 0.3
