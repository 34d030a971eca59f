"""Simple bodies that contain a shape, held against points of it."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.shapes import Box, Capsule, Cylinder, Sphere
from arms.around import KINDS, surface
from arms.grazing import obstacle
from plan.collision.covers import cover, hull, rounded_box


@pytest.mark.parametrize("kind", KINDS)
def test_hulls_and_balls_hold_their_body(kind: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(30):
        shape = obstacle(kind, rng)
        points = surface(shape, rng, 200)
        centres, radius = cover(shape)
        apart = np.linalg.norm(points[:, None] - centres, axis=2).min(axis=1)
        assert apart.max() <= radius + 1e-12
        corners, ball = hull(shape)
        directions = rng.normal(size=(50, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        assert np.all(
            (points @ directions.T).max(axis=0) <= (corners @ directions.T).max(axis=0) + ball + 1e-12
        )


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in ("mesh", "torus")])
def test_the_radius_of_covering_balls_is_bounded_by_their_pitch(kind: str) -> None:
    """Each holds a part that is at most as long as it is wide, while there are fewer than four."""
    rng = np.random.default_rng(3)
    for _ in range(60):
        shape = obstacle(kind, rng)
        centres, radius = cover(shape)
        match shape:
            case Box(size):
                across, length = float(np.linalg.norm(np.sort(size)[:2])) / 2.0, max(size)
            case Cylinder(across, length):
                pass
            case Capsule(across, length):
                length += 2.0 * across
            case Sphere(across):
                length = 0.0
        needed = max(int(np.ceil(length / (2.0 * across))), 1)
        assert len(centres) == min(needed, 4)
        assert radius <= np.sqrt(2.0) * across + 1e-12 or needed > 4


@pytest.mark.parametrize("kind", KINDS)
def test_a_rounded_box_holds_its_body(kind: str) -> None:
    """By its support function, the sum of those of a box, a disc across z and a ball."""
    rng = np.random.default_rng(4)
    for _ in range(30):
        shape = obstacle(kind, rng)
        middle, half, tube, ball = rounded_box(shape)
        directions = rng.normal(size=(50, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        support = directions @ middle + np.abs(directions) @ half + tube * np.hypot(*directions.T[:2]) + ball
        assert np.all((surface(shape, rng, 200) @ directions.T).max(axis=0) <= support + 1e-12)
