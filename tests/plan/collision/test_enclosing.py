"""Few points that enclose a hull, held against coal's distances."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.shapes import Body, Sphere, convex
from arm.se3 import Array, transform
from plan.collision.covers import cover
from plan.collision.enclosing import few_points
from plan.collision.world import distance_of


def link(rng: np.random.Generator, count: int) -> Array:
    """Points on a tube with a flange, as of a mesh."""
    angle, along = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.0, 0.4, count)
    radius = np.where(along > 0.36, 0.08, 0.05)
    return np.stack([along, radius * np.cos(angle), radius * np.sin(angle)], axis=1)


@pytest.mark.parametrize("seed", range(4))
def test_no_point_is_further_from_the_hull_of_the_few_than_the_radius(seed: int) -> None:
    points = link(np.random.default_rng(seed), 400)
    few, radius = few_points(points)
    assert len(few) <= 40
    inner = Body("few", convex(few), transform(), "hull")
    ball = 1e-4
    away = [
        distance_of(inner, Body("point", Sphere(ball), transform(t=p), "point")).value + ball for p in points
    ]
    assert max(away) <= radius + 1e-6
    assert radius <= 1.5 * max(away) + 1e-4
    assert radius < 0.01


def test_a_hull_of_few_points_is_left_as_it_is() -> None:
    points = link(np.random.default_rng(0), 40)
    few, radius = few_points(points)
    np.testing.assert_array_equal(few, points)
    assert radius == 0.0


def test_a_long_hull_is_covered_by_several_balls_that_hold_it() -> None:
    rng = np.random.default_rng(5)
    shape = convex(link(rng, 300))
    centres, radius = cover(shape)
    assert len(centres) >= 3
    assert radius < 0.13
    inside = rng.dirichlet(np.full(len(shape.points), 0.02), 4000) @ np.array(shape.points)
    assert np.linalg.norm(inside[:, None] - centres, axis=-1).min(axis=1).max() <= radius + 1e-9
