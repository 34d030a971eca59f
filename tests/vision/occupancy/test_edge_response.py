"""Steps of grey across borders: seen where they are, not elsewhere, whatever the noise."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import cv2
import numpy as np
import pytest

from arm.se3 import Array, apply, transform
from pictures.boards import lab_camera
from vision.camera.model import Image
from vision.occupancy.edge_response import (
    PlateView,
    mean_step,
    plate_view,
    rough_part,
    seen_stations,
    step_limits,
)

CAMERA = lab_camera()
PLANE = transform(t=(0.45, -0.02, 0.05))
REACH = 0.024
CONTRAST = 150.0
LINE = np.stack([np.zeros(24), np.linspace(-0.017, 0.017, 24)], axis=-1)
RIGHT = np.tile([1.0, 0.0], (24, 1))
PATCH = 0.8e-3 * np.stack(np.meshgrid(np.arange(-20, 21), np.arange(-20, 21)), axis=-1)
ANGLE = 2.0 * np.pi * np.arange(36) / 36
RING = np.stack([np.cos(ANGLE), np.sin(ANGLE)], axis=-1)


@cache
def _places() -> tuple[tuple[int, int, int, int], Array]:
    """The part of the image (top, bottom, left, right) around the plane's origin, and what 4 x 4 rays a pixel meet."""
    square = np.array([[x, y, 0.0] for x in (-0.025, 0.025) for y in (-0.025, 0.025)])
    corners = CAMERA.project_base(apply(PLANE, square))
    (left, top), (right, bottom) = (
        np.floor(corners.min(axis=0)).astype(int),
        np.ceil(corners.max(axis=0)).astype(int),
    )
    u, v = np.meshgrid(np.arange(left, right, 0.25) - 0.375, np.arange(top, bottom, 0.25) - 0.375)
    rays = np.pad(CAMERA.normalised(np.stack([u, v], axis=-1)), ((0, 0), (0, 0), (0, 1)), constant_values=1.0)
    rays, eye = rays @ CAMERA.T_base_camera[:3, :3].T, CAMERA.T_base_camera[:3, 3]
    met = eye + rays * ((PLANE[2, 3] - eye[2]) / rays[..., 2:])
    return (top, bottom, left, right), met[..., :2] - PLANE[:2, 3]


def drawn(grey_at: Callable[[Array, Array], Array], noise: float, seed: int = 0, blur: float = 0.7) -> Image:
    """A photograph of a plane with that grey at its places (x, y) m."""
    (top, bottom, left, right), places = _places()
    fine = grey_at(places[..., 0], places[..., 1]).astype(np.float32)
    part = cv2.GaussianBlur(
        cv2.resize(fine, (right - left, bottom - top), interpolation=cv2.INTER_AREA), (0, 0), blur
    )
    noisy = part + noise * np.random.default_rng(seed).standard_normal(part.shape)
    image = np.full(CAMERA.size[::-1], 100, dtype=np.uint8)
    image[top:bottom, left:right] = np.clip(np.rint(noisy), 0, 255)
    return image


def view_of(image: Image) -> PlateView:
    view = plate_view([image], CAMERA, PLANE, REACH)
    assert view is not None
    return view


@pytest.mark.parametrize("noise", [1.0, 3.0, 8.0])
def test_noise_is_estimated_beside_an_edge(noise: float) -> None:
    view = view_of(drawn(lambda x, y: np.where(x > 0.005, 160.0, 90.0), noise))
    assert view.noise() == pytest.approx(np.hypot(noise, 12**-0.5), rel=0.08)
    four = [drawn(lambda x, y: np.where(x > 0.005, 160.0, 90.0), noise, seed) for seed in range(4)]
    mean = plate_view(four, CAMERA, PLANE, REACH)
    assert mean is not None
    assert mean.noise() == pytest.approx(np.hypot(noise, 12**-0.5) / 2.0, rel=0.08)


@pytest.mark.parametrize(
    ("shift_mm", "seen"), [(-0.45, True), (0.0, True), (0.45, True), (2.0, False), (-2.0, False)]
)
@pytest.mark.parametrize("step", [25.0, -25.0])
def test_a_step_is_seen_within_the_tolerance(shift_mm: float, seen: bool, step: float) -> None:
    view = view_of(drawn(lambda x, y: 120.0 + np.where(x > shift_mm * 1e-3, step, 0.0), 3.0))
    shows = seen_stations(view, LINE, RIGHT, step_limits(view, CONTRAST, 0.5e-3), ring=False)
    assert shows.mean() > 0.95 if seen else shows.mean() < 0.1


def test_noise_and_soft_light_are_no_steps() -> None:
    parts = []
    for seed in range(12):
        view = view_of(drawn(lambda x, y: 120.0 + 1500.0 * x, 12.0, seed))  # 1.5 grey levels a millimetre
        limits = step_limits(view, CONTRAST, 0.5e-3)
        parts.append(seen_stations(view, LINE, RIGHT, limits, ring=False).mean())
        assert rough_part(view, PATCH, limits) < 0.004
    assert np.mean(parts) < 0.12


def test_a_shadow_across_turns_a_step_round_but_not_the_rim_of_a_ring() -> None:
    view = view_of(drawn(lambda x, y: np.where(x > 0, np.where(y > 0, 150.0, 90.0), 120.0), 2.0))
    limits = step_limits(view, CONTRAST, 0.5e-3)
    assert seen_stations(view, LINE, RIGHT, limits, ring=False).mean() > 0.9
    steep = view_of(
        drawn(lambda x, y: 120.0 + 12_000.0 * x, 2.0)
    )  # up on the right, down on the left: no rim
    assert seen_stations(steep, 0.008 * RING, RING, limits, ring=True).mean() < 0.6
    hole = view_of(drawn(lambda x, y: np.where(np.hypot(x, y - 3e-4) < 0.008, 40.0, 90.0), 2.0))
    shows = seen_stations(hole, 0.008 * RING, RING, step_limits(hole, CONTRAST, 0.5e-3), ring=True)
    assert shows.all()
    assert mean_step(hole, 0.008 * RING, RING) == pytest.approx(50.0, rel=0.15)


def test_what_is_outside_the_image_is_not_a_number() -> None:
    image = drawn(lambda x, y: np.where(x > 0, 150.0, 90.0), 2.0)
    beside = transform(t=CAMERA.T_base_camera[:3, 3] * (1.0, 1.0, 0.0) + (0.0, 0.225, 0.05))
    view = plate_view([image], CAMERA, beside, REACH)
    assert view is not None
    shows = seen_stations(view, LINE, RIGHT, step_limits(view, CONTRAST, 0.5e-3), ring=False)
    inside = CAMERA.project_base(np.pad(LINE, ((0, 0), (0, 1))) + beside[:3, 3])
    margin = np.minimum(inside, np.array(CAMERA.size) - 1 - inside).min(axis=1)
    assert (np.isnan(shows) == (margin < 0)).mean() > 0.9
    assert np.isnan(shows).any()
    assert np.isfinite(shows).any()
    assert plate_view([image], CAMERA, transform(t=(2.0, 0.0, 0.05)), REACH) is None


def test_an_edge_within_a_patch_makes_it_rough() -> None:
    for angle in (0.0, 0.4, 1.2):
        n = np.array([np.cos(angle), np.sin(angle)])
        view = view_of(drawn(lambda x, y, n=n: np.where(x * n[0] + y * n[1] > 0.004, 140.0, 115.0), 3.0))
        assert rough_part(view, PATCH, step_limits(view, CONTRAST, 0.5e-3)) > 0.015
