"""Light on surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.robot.shapes import Body, Convex
from arm.se3 import apply, inverse, rot_y, transform
from cell.scene.bodies import cube_body
from pictures.rendered import grey_at
from pictures.solids import random_pose, random_shape, signed_distance
from render.light import Light
from render.rays import pixel_rays
from render.renderer import render
from render.solids import BodySolid
from vision.camera.model import Camera, read_camera


@pytest.mark.parametrize("seed", range(12))
def test_surfaces_are_lit_by_the_cosine_law(seed: int, small: Camera) -> None:
    rng = np.random.default_rng(seed)
    light = Light(lamp=(1.1, 0.7, 1.5), ambient=0.4)
    body = Body("thing", random_shape(rng), random_pose(rng, 0.03), "cube")
    rays = pixel_rays(small)
    cast = BodySolid(body, light).cast(small.T_base_camera, rays)
    met = np.isfinite(cast.depth)
    direction = np.stack([rays.x, rays.y, np.ones_like(rays.x)], axis=-1)[met].astype(float)
    points = apply(inverse(body.T_base_body) @ small.T_base_camera, direction * cast.depth[met, None])
    steps = 1e-4 * np.eye(3)
    gradient = [
        signed_distance(body.shape, points + d) - signed_distance(body.shape, points - d) for d in steps
    ]
    normals = np.stack(gradient, axis=-1) / 2e-4
    flat = 1e-6 if isinstance(body.shape, Convex) else 1e-4  # hulls have edges of a few degrees
    inside_a_face = np.abs(np.linalg.norm(normals, axis=-1) - 1.0) < flat  # not beside an edge
    towards = np.array(light.lamp) - body.T_base_body[:3, 3]
    cosine = normals @ body.T_base_body[:3, :3].T @ towards / np.linalg.norm(towards)
    expected = 205.0 * (0.4 + 0.6 * np.maximum(cosine, 0.0))
    assert np.count_nonzero(inside_a_face) > 100
    assert np.abs(cast.grey[met] - expected)[inside_a_face].max() < 0.3


@pytest.fixture(scope="module")
def camera() -> Camera:
    return read_camera(data_file("scenes/cameras/lab.toml"))


@pytest.fixture(scope="module")
def small(camera: Camera) -> Camera:
    """The lab's view at a quarter of its resolution."""
    K = camera.K * np.array([[0.25], [0.25], [1.0]])
    return Camera(K, camera.distortion, (480, 300), camera.T_base_camera)


def test_a_cube_shows_a_lit_top_and_darker_sides(small: Camera) -> None:
    cube = cube_body("cube", 0.08, transform(rot_y(np.radians(30.0)), (0.46, 0.02, 0.15)))
    image = render(small, [cube], [], light=Light(lamp=(0.2, 0.0, 2.5), shadow=0.0, vignette=0.0))
    top = grey_at(image, small, apply(cube.T_base_body, (0.0, 0.0, 0.04)))
    side = grey_at(image, small, apply(cube.T_base_body, (-0.04, 0.0, 0.0)))
    towards = np.array([0.2, 0.0, 2.5]) - cube.T_base_body[:3, 3]
    towards /= np.linalg.norm(towards)
    for seen, normal in ((top, cube.T_base_body[:3, 2]), (side, -cube.T_base_body[:3, 0])):
        assert seen == pytest.approx(205.0 * (0.45 + 0.55 * max(float(normal @ towards), 0.0)), abs=0.1)
    assert side < top - 10.0
