"""Windows of solids hide nothing, and spare most of the image."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.shapes import Body, Box
from arm.se3 import transform
from pictures.solids import random_pose, random_shape
from render.first_hit import in_view
from render.light import Light
from render.rays import pixel_rays
from render.solids import BodySolid
from render.window import Window
from vision.camera.model import Camera


def require_window_holds(solid: BodySolid, camera: Camera) -> None:
    rays = pixel_rays(camera)
    rows, columns = np.nonzero(np.isfinite(solid.cast(camera.T_base_camera, rays).depth))
    if len(rows):
        window = in_view([solid], camera.T_base_camera, rays)[0].window
        width, height = camera.size
        assert window.top <= max(rows.min() - 1, 0)
        assert window.bottom >= min(rows.max() + 2, height)
        assert window.left <= max(columns.min() - 1, 0)
        assert window.right >= min(columns.max() + 2, width)


@pytest.mark.parametrize("seed", range(40))
def test_windows_leave_out_no_pixel_nor_its_neighbours(seed: int, small: Camera) -> None:
    rng = np.random.default_rng(seed)
    spread = (0.3, 0.9, 1.5)[seed % 3]  # also beside the image
    require_window_holds(
        BodySolid(Body("thing", random_shape(rng), random_pose(rng, spread), "cube"), Light()), small
    )


@pytest.mark.parametrize(("dx", "dy"), [(-0.1, 0.0), (0.07, 0.05), (0.0, -0.2)])
def test_the_window_of_a_post_that_passes_the_camera(dx: float, dy: float, small: Camera) -> None:
    x, y, _ = small.T_base_camera[:3, 3]
    post = Body("post", Box((0.03, 0.03, 2.0)), transform(t=(x + dx, y + dy, 1.0)), "wall")
    require_window_holds(BodySolid(post, Light()), small)


def test_a_window_spares_most_of_the_image(camera: Camera) -> None:
    solid = BodySolid(Body("cube", Box((0.04,) * 3), transform(t=(0.46, 0.0, 0.02)), "cube"), Light())
    window = in_view([solid], camera.T_base_camera, pixel_rays(camera))[0].window
    assert (window.bottom - window.top) * (window.right - window.left) < 260**2  # the cube covers 170**2


def test_window_area_indexes_an_image() -> None:
    image = np.arange(12).reshape(3, 4)
    assert image[Window(1, 3, 2, 4).area].tolist() == [[6, 7], [10, 11]]
