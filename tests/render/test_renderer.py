"""The picture as a photograph: light, shadow, noise, and what it costs."""

from __future__ import annotations

import tracemalloc

import cv2
import numpy as np
import pytest

from arm.io.storage import data_file
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box, Cylinder, Sphere
from arm.se3 import apply, rotation, transform
from pictures.rendered import TABLE, board_with_cubes, grey_at
from render.light import Light
from render.renderer import Exposure, exposed, render, with_noise
from timed.relative import relative_cost
from vision.camera.model import Camera, read_camera


@pytest.fixture(scope="module")
def camera() -> Camera:
    return read_camera(data_file("scenes/cameras/lab.toml"))


@pytest.fixture(scope="module")
def small(camera: Camera) -> Camera:
    """The lab's view at a quarter of its resolution."""
    K = camera.K * np.array([[0.25], [0.25], [1.0]])
    return Camera(K, camera.distortion, (480, 300), camera.T_base_camera)


def test_what_the_eye_needs_to_tell_apart_differs(small: Camera) -> None:
    place, cubes = board_with_cubes((0, 2))
    image = render(small, [TABLE, *cubes], [place])
    T, board = place.T_base_board, place.board
    cube_tops = [grey_at(image, small, apply(c.T_base_body, (0, 0, 0.02))) for c in cubes]
    floors = [grey_at(image, small, apply(T, board.holes[h] + (0.013, 0.0, -0.010))) for h in (1, 3)]
    plate = grey_at(image, small, apply(T, (0.04, 0.04, 0.0)))
    table = grey_at(image, small, (0.54, 0.20, 0.0))
    white = grey_at(image, small, apply(T, (0.021, 0.0, 0.0)))
    black = grey_at(image, small, apply(T, (0.0155, 0.0, 0.0)))
    assert min(cube_tops) > plate + 30.0
    assert max(floors) < plate - 50.0
    assert plate > table + 20.0
    assert white > black + 150.0


def test_exposure_scales_and_saturates(small: Camera) -> None:
    place, cubes = board_with_cubes((0,))
    once, half, much = (render(small, [TABLE, *cubes], [place], light=Light(gain=g)) for g in (1.0, 0.5, 3.0))
    lit = once > 60.0
    assert np.abs(half[lit] / once[lit] - 0.5).max() < 1e-3
    assert much.max() == 255.0
    assert with_noise(much, np.random.default_rng(0)).max() == 255


def test_noise_has_the_stated_strength_and_no_bias() -> None:
    image = np.full((400, 500), 120.3, dtype=np.float32)
    noisy = with_noise(image, np.random.default_rng(1), 2.0).astype(float)
    assert noisy.mean() == pytest.approx(120.3, abs=0.02)
    assert noisy.std() == pytest.approx(np.hypot(2.0, 1.0 / np.sqrt(12.0)), abs=0.02)  # with rounding's share
    residual = noisy - noisy.mean()
    for a, b in ((residual[1:], residual[:-1]), (residual[:, 1:], residual[:, :-1])):
        assert abs((a * b).mean()) / residual.var() < 0.01  # neighbours are independent
    assert np.array_equal(with_noise(image, np.random.default_rng(1), 0.0), np.full((400, 500), 120))


def test_noise_follows_its_seed_and_the_picture_none(small: Camera) -> None:
    place, cubes = board_with_cubes((1,))
    first, second = (render(small, [TABLE, *cubes], [place]) for _ in range(2))
    assert np.array_equal(first, second)
    frames = [with_noise(first, np.random.default_rng(s)) for s in (7, 7, 8)]
    assert frames[0].dtype == np.uint8
    assert np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[0], frames[2])
    rng = np.random.default_rng(7)
    assert not np.array_equal(with_noise(first, rng), with_noise(first, rng))


def test_the_blur_is_the_one_asked_for(small: Camera) -> None:
    edge = [Body("half", Box((1.0, 1.0, 0.02)), transform(t=(0.96, 0.0, -0.01)), "cube")]
    even = Light(shadow=0.0, vignette=0.0)
    (u, v) = np.rint(small.project_base((0.46, 0.0, 0.0))).astype(int)  # the edge runs along a row here

    def variance(psf_px: float) -> float:
        column = render(small, edge, [], psf_px=psf_px, light=even)[v - 15 : v + 16, u]
        weights, rows = np.abs(np.diff(column.astype(float))), np.arange(30.0)
        weights /= weights.sum()
        return float((weights * (rows - (weights * rows).sum()) ** 2).sum())

    assert variance(1.5) - variance(0.0) == pytest.approx(1.5**2, rel=0.05)


def test_the_order_of_bodies_does_not_matter(small: Camera) -> None:
    rng = np.random.default_rng(2)
    bodies = [TABLE] + [
        Body(
            f"b{i}",
            (Box((0.05, 0.1, 0.05)), Cylinder(0.02, 0.2), Sphere(0.04))[i % 3],
            transform(rotation(rng.normal(size=3)), (0.46, 0.0, 0.15) + rng.uniform(-0.08, 0.08, 3)),
            ("cube", "robot", "stand")[i % 3],
        )
        for i in range(12)
    ]
    assert np.array_equal(render(small, bodies, []), render(small, bodies[::-1], []))


def test_bodies_across_and_behind_the_camera_do_no_harm(small: Camera) -> None:
    x, y, z = small.T_base_camera[:3, 3]
    around = [
        Body("post", Box((0.08, 0.08, 2.0)), transform(t=(x + 0.15, y, 1.0)), "wall"),
        Body("ceiling", Box((2.0, 2.0, 0.02)), transform(t=(x, y, z + 0.3)), "wall"),
        Body("ball", Sphere(0.1), transform(t=(x, y, z + 1.0)), "robot"),
        Body("column", Cylinder(0.05, 3.0), transform(t=(x - 0.2, y, 1.0)), "robot"),
    ]
    assert np.isfinite(render(small, [TABLE, *around], [])).all()
    assert np.isfinite(render(small, around[1:3], [])).all()
    empty = render(small, [], [])
    assert empty.shape == (300, 480)
    assert empty.dtype == np.float32
    assert empty.max() == pytest.approx(40.0)


def test_a_full_picture_costs_little_time_and_memory(camera: Camera) -> None:
    place, cubes = board_with_cubes((0, 1, 2, 3))
    arm = load_a465(0.134112, 0.06).bodies_at(np.radians([0.0, 12.0, -105.0, 0.0, -40.0, 20.0]))
    blurred = np.zeros((1200, 1920), np.uint8)
    cost = relative_cost(
        lambda: render(camera, [TABLE, *cubes, *arm], [place]),
        lambda: cv2.GaussianBlur(blurred, (0, 0), 3.0),
        rounds=1,
        enough=300.0,
    )
    assert cost < 300.0
    tracemalloc.start()
    image = render(camera, [TABLE, *cubes, *arm], [place])
    assert image.shape == (1200, 1920)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400e6


def test_an_exposure_scales_bends_and_tilts_grey_levels() -> None:
    image = np.linspace(0.0, 255.0, 30 * 41, dtype=np.float32).reshape(30, 41)
    assert exposed(image, Exposure()) is image
    bright = with_noise(exposed(image, Exposure(gain=1.5)), np.random.default_rng(0), 0.0)
    assert np.array_equal(bright, np.clip(np.rint(1.5 * image), 0, 255))
    assert exposed(image, Exposure(gamma=0.45)) == pytest.approx(255.0 * (image / 255.0) ** 0.45, abs=1e-2)
    tilted = exposed(np.full((31, 41), 100.0, dtype=np.float32), Exposure(gradient=(0.1, -0.2)))
    assert [tilted[15, 0], tilted[15, 40], tilted[0, 20], tilted[30, 20]] == pytest.approx([90, 110, 120, 80])


def test_what_is_overexposed_saturates_without_noise() -> None:
    bright = with_noise(
        exposed(np.full((99, 99), 235.0, np.float32), Exposure(gain=1.3)), np.random.default_rng(0)
    )
    assert bright.min() == 255
