"""The first hit among all solids."""

from __future__ import annotations

import numpy as np

from arm.robot.shapes import Body
from pictures.solids import random_pose, random_shape
from render.first_hit import first_hits, in_view
from render.light import Light
from render.rays import pixel_rays
from render.solids import BodySolid
from vision.camera.model import Camera


def test_the_nearest_wins_whatever_the_order(small: Camera) -> None:
    rng = np.random.default_rng(5)
    bodies = [Body(f"b{i}", random_shape(rng), random_pose(rng, 0.15), "cube") for i in range(8)]
    solids = [BodySolid(b, Light()) for b in bodies]
    rays, T = pixel_rays(small), small.T_base_camera
    alone = np.min([s.cast(T, rays).depth for s in solids], axis=0)
    for order in (solids, solids[::-1]):
        hits = first_hits(in_view(order, T, rays), T, rays)
        assert np.array_equal(hits.depth, alone)
