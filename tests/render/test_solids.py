"""Rays and solids: the lens undone, hits on the surface and nothing before them, windows that hide nothing."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.shapes import Body, Box, Capsule, Cylinder, Shape, Sphere, Torus
from arm.se3 import apply, inverse, transform
from pictures.solids import SOLID_CUBE, random_pose, random_shape, signed_distance
from render.light import Light
from render.rays import pixel_rays
from render.solids import BodySolid
from vision.camera.model import Camera


@pytest.mark.few(6)
@pytest.mark.parametrize("seed", range(18))
def test_a_hit_is_on_the_surface_and_nothing_is_before_it(seed: int, small: Camera) -> None:
    rng = np.random.default_rng(seed)
    body = Body("thing", random_shape(rng), random_pose(rng, 0.08), "cube")
    rays = pixel_rays(small)
    cast = BodySolid(body, Light()).cast(small.T_base_camera, rays)
    T_body_camera = inverse(body.T_base_body) @ small.T_base_camera
    direction = np.stack([rays.x, rays.y, np.ones_like(rays.x)], axis=-1).astype(float)
    met = np.isfinite(cast.depth)
    assert met.any()
    on_surface = apply(T_body_camera, direction[met] * cast.depth[met, None])
    assert np.abs(signed_distance(body.shape, on_surface)).max() < 2e-6
    for share in np.linspace(0.02, 0.999, 60):  # along each ray, up to its hit or to beyond the body
        depth = share * np.where(met, cast.depth, 3.0)
        before = signed_distance(body.shape, apply(T_body_camera, direction * depth[..., None]))
        assert before.min() > -2e-6


@pytest.mark.parametrize(
    "shape",
    [
        Box((0.1, 0.1, 0.1)),
        Cylinder(0.08, 0.1),
        Sphere(0.1),
        Capsule(0.05, 0.4),  # the camera between its balls
        Capsule(0.05, 0.02),  # the camera in one of them
        Torus(0.05, 0.06),
        SOLID_CUBE,
    ],
)
def test_a_solid_that_holds_the_camera_or_is_behind_it_is_not_seen(shape: Shape, small: Camera) -> None:
    x, y, z = small.T_base_camera[:3, 3]
    for place in ((x + 0.01, y - 0.02, z + 0.015), (x + 0.01, y, z - 0.015), (x, y, z + 0.5)):
        solid = BodySolid(Body("thing", shape, transform(t=place), "wall"), Light())
        assert not np.isfinite(solid.cast(small.T_base_camera, pixel_rays(small)).depth).any()
