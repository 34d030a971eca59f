"""Rays at convex hulls."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.shapes import Body, Box
from pictures.solids import SOLID_CUBE, random_pose
from render.hulls import Hull
from render.light import Light
from render.rays import Bundle, pixel_rays
from render.solids import BodySolid
from vision.camera.model import Camera


def test_a_box_and_the_hull_of_its_corners_look_the_same(small: Camera) -> None:
    rng = np.random.default_rng(8)
    for _ in range(5):
        pose = random_pose(rng, 0.1)
        rays = pixel_rays(small)
        box, hull = (
            BodySolid(Body("thing", shape, pose, "cube"), Light()).cast(small.T_base_camera, rays)
            for shape in (Box((0.1, 0.1, 0.1)), SOLID_CUBE)
        )
        both = np.isfinite(box.depth)
        assert np.count_nonzero(both != np.isfinite(hull.depth)) <= 4  # rays along the outline
        both &= np.isfinite(hull.depth)
        assert np.abs(box.depth[both] - hull.depth[both]).max() < 2e-6
        assert np.count_nonzero(np.abs(box.grey[both] - hull.grey[both]) > 0.01) <= 4  # rays along an edge


def test_a_ray_along_a_face_meets_a_hull_only_if_it_is_not_above_it() -> None:
    hull = Hull(SOLID_CUBE)
    ones, zeros = np.ones(1, dtype=np.float32), np.zeros(1, dtype=np.float32)
    for height, met in ((0.049, True), (0.051, False), (-0.051, False)):
        bundle = Bundle(np.array([-1.0, 0.0, height]), ones, zeros, zeros)
        depth, face = hull.enter(bundle, 1e-7)
        assert np.isfinite(depth[0]) == met
        if met:
            assert depth[0] == pytest.approx(0.95)
            assert hull.normals[face[0]] == pytest.approx([-1.0, 0.0, 0.0])
