"""Distances of points from bodies against coal's, and their gradients."""

from __future__ import annotations

import coal
import numpy as np
import pytest

from arm.robot.shapes import Box, Capsule, Cylinder, Shape, Sphere, Torus, convex
from arm.se3 import Array
from plan.collision.narrow.coal_shapes import GJK_TOLERANCE, coal_shape
from plan.collision.narrow.solids import HullSolids, RoundedSolids

CONVEX: list[Shape] = [
    Box((0.1, 0.2, 0.05)),
    Box((0.3, 0.2, 0.0002)),
    Cylinder(0.05, 0.2),
    Capsule(0.04, 0.1),
    Sphere(0.06),
]
TORUS = Torus(0.08, 0.01)
HULL = convex(np.random.default_rng(0).uniform(-0.1, 0.1, (20, 3)))


def points(seed: int, bodies: int, count: int = 200) -> Array:
    """Points (3, bodies, count) in and around bodies at the origin, some of them on axes and planes of symmetry."""
    rng = np.random.default_rng(seed)
    spread = rng.uniform(-0.15, 0.15, (3, bodies, count))
    return np.asarray(np.where(rng.random(spread.shape) < 0.1, 0.0, spread))


def of_coal(shape: Shape, at: Array) -> float:
    """The distance of a tiny ball's centre; minus the depth inside."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = GJK_TOLERANCE
    here, there = coal.Transform3s(), coal.Transform3s()
    there.setTranslation(at)
    return 1e-6 + float(coal.distance(coal_shape(shape), here, coal.Sphere(1e-6), there, request, result))


def test_distances_of_points_are_coals() -> None:
    solids, at = RoundedSolids(CONVEX), points(1, len(CONVEX))
    value, _ = solids.measure(np.arange(len(CONVEX)), at)
    inside = 0
    for i, shape in enumerate(CONVEX):
        wanted = np.array([of_coal(shape, p) for p in at[:, i].T])
        found = value[i] - solids.ball[i]
        assert np.abs(found - wanted)[wanted > -solids.ball[i]].max() < 2e-6
        assert ((found < 0.0) == (wanted < 0.0)).mean() > 0.99
        inside += int((wanted < -1e-3).sum())
    assert inside > 50
    assert solids.convex.all()


def test_the_depth_inside_is_that_of_the_nearest_face() -> None:
    at = np.array([[0.049, 0.0, 0.0, 0.0], [0.0, -0.08, 0.0, 0.0], [0.0, 0.0, 0.02, 0.0]])
    value, gradient = RoundedSolids([Box((0.1, 0.2, 0.05))]).measure(np.array([0]), at[:, None])
    assert value[0] == pytest.approx([-0.001, -0.02, -0.005, -0.025])
    assert gradient[:, 0, :3].tolist() == [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
    value, gradient = RoundedSolids([Cylinder(0.05, 0.2)]).measure(np.array([0]), at[:, None])
    assert value[0] == pytest.approx([-0.001, 0.03, -0.05, -0.05])
    assert gradient[:, 0, 0] == pytest.approx([1.0, 0.0, 0.0])


def test_the_distance_from_a_torus_is_that_from_its_circle() -> None:
    solids, at = RoundedSolids([TORUS]), points(2, 1)
    value, _ = solids.measure(np.array([0]), at)
    wanted = np.hypot(np.hypot(at[0], at[1]) - TORUS.radius, at[2])
    assert value == pytest.approx(wanted, abs=1e-15)
    assert not solids.convex.any()
    assert solids.ball == pytest.approx([TORUS.tube])


def test_gradients_are_unit_vectors_and_those_of_the_distance() -> None:
    """Also where the distance has a kink: there, of one of the nearest points."""
    shapes = [*CONVEX, TORUS]
    solids, at, step = RoundedSolids(shapes), points(3, 6), 1e-7
    every = np.arange(len(shapes))
    _, gradient = solids.measure(every, at)
    assert np.sqrt((gradient * gradient).sum(axis=0)) == pytest.approx(1.0, abs=1e-12)
    moves = step * np.eye(3)[:, :, None, None]
    change = [solids.measure(every, at + move)[0] - solids.measure(every, at - move)[0] for move in moves]
    smooth = (at != 0.0).all(axis=0)
    error = np.abs(np.array(change) / (2.0 * step) - gradient).max(axis=0)[smooth]
    assert np.quantile(error, 0.99) < 1e-6  # a few points are at an edge


def test_hulls_are_measured_by_coal() -> None:
    solids, at, step = HullSolids([HULL, HULL]), points(4, 1, 60), 1e-4
    value, gradient = solids.measure(np.array([1]), at)
    assert value[0] == pytest.approx([of_coal(HULL, p) for p in at[:, 0].T], abs=1e-9)
    outside = value[0] > 0.0
    back = at - value * gradient  # the nearest points of the hull
    assert np.abs(solids.measure(np.array([0]), back)[0][0, outside]).max() < solids.error
    further = solids.measure(np.array([0]), at + step * gradient)[0]
    assert further[0, outside] == pytest.approx(value[0, outside] + step, abs=2.0 * solids.error)
