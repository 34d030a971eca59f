"""The least distance of circles from bodies against dense sampling, and the bounds that prove it."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from arm.robot.shapes import Box, Capsule, Convex, Cylinder, Sphere, Torus
from arm.se3 import Array, rotation
from arms.around import KINDS
from arms.grazing import obstacle
from plan.collision.narrow.circle import ERROR, Circles, _from_convex, _from_torus, nearest
from plan.collision.narrow.solids import HullSolids, RoundedSolids, Solids

ROUNDED = [kind for kind in KINDS if kind != "mesh"]


def some_circles(rng: np.random.Generator, count: int) -> Circles:
    """Circles of 5 mm to 3 m, each about its body's place, some exactly coaxial or parallel to its faces."""
    radius = np.where(rng.random(count) < 0.5, 0.0324, 10.0 ** rng.uniform(-2.3, 0.5, count))
    turns = [rotation(rng.normal(size=3)) if rng.random() < 0.8 else np.eye(3) for _ in range(count)]
    centre = rng.uniform(-1.0, 1.0, (3, count)) * rng.choice([0.0, 0.01, 0.1, 0.4], count)
    x, y, _ = np.array(turns).transpose(2, 1, 0) * radius
    return Circles(centre, x, y, radius, np.arange(count))


def on_circle(circles: Circles, angles: Array) -> Array:
    """Points (3, k, n) at angles (k, n)."""
    x, y = circles.x[..., None] * np.cos(angles), circles.y[..., None] * np.sin(angles)
    return np.asarray(circles.centre[..., None] + x + y)


def dense(circles: Circles, solids: Solids, count: int) -> Array:
    """The least distances (k,) of many points, then of many about the nearest one, twice."""
    angles = np.tile(np.linspace(0.0, 2.0 * np.pi, count), (len(circles.body), 1))
    least = np.full(len(circles.body), inf)
    for _ in range(3):
        value, _ = solids.measure(circles.body, on_circle(circles, angles))
        least = np.minimum(least, value.min(axis=1))
        middle = np.take_along_axis(angles, value.argmin(axis=1)[:, None], axis=1)
        angles = middle + (angles[:, 1:2] - angles[:, :1]) * np.linspace(-1.0, 1.0, 200)
    return least


def test_nearest_points_are_those_of_dense_samples() -> None:
    rng = np.random.default_rng(1)
    solids = RoundedSolids([obstacle(kind, rng) for kind in ROUNDED for _ in range(60)])
    circles = some_circles(rng, len(solids.ball))
    found, wanted = nearest(circles, solids), dense(circles, solids, 4001)
    assert (found.distance - wanted).max() < ERROR
    assert (found.distance - wanted).min() > -1e-7  # of the samples
    assert (found.distance < 0.0).sum() > 30
    # and they are such points
    away = found.point - circles.centre
    assert np.sqrt((away * away).sum(axis=0)) == pytest.approx(circles.radius, rel=1e-12)
    value, _ = solids.measure(circles.body, found.point[..., None])
    assert value[:, 0] == pytest.approx(found.distance, abs=1e-12)
    assert np.sqrt((found.away * found.away).sum(axis=0)) == pytest.approx(1.0, abs=1e-12)


def test_hulls_are_searched_as_well() -> None:
    rng = np.random.default_rng(2)
    shapes = [obstacle("mesh", rng) for _ in range(12)]
    solids = HullSolids([shape for shape in shapes if isinstance(shape, Convex)])
    circles = some_circles(rng, len(shapes))
    error = nearest(circles, solids).distance - dense(circles, solids, 801)
    assert error.max() < ERROR + solids.error
    assert error.min() > -1e-5  # of the samples


@pytest.mark.parametrize("radius", [0.01, 0.0324, 0.7])
def test_circles_on_the_axis_of_bodies(radius: float) -> None:
    """All points are equally near, so all of the circle is searched."""
    shapes = [
        Capsule(0.005, 0.2),
        Cylinder(0.005, 0.2),
        Sphere(0.005),
        Torus(0.9, 0.01),
        Box((4.0, 4.0, 0.1)),
    ]
    centre = np.array([[0.0] * 5, [0.0] * 5, [0.02, 0.0, 0.03, 0.3, 0.12]])
    x, y = radius * np.eye(3)[:2, :, None].repeat(5, axis=2)
    solids = RoundedSolids(shapes)
    found = nearest(Circles(centre, x, y, np.full(5, radius), np.arange(5)), solids)
    wanted = [
        radius - 0.005,
        radius - 0.005,
        np.hypot(radius, 0.03) - 0.005,
        np.hypot(0.9 - radius, 0.3) - 0.01,
        0.07,
    ]
    assert found.distance - solids.ball == pytest.approx(wanted, abs=1e-12)


def test_what_is_below_a_limit_is_found_and_nothing_else() -> None:
    """All limits but one are out of reach; the other one is just above or below the distance."""
    rng = np.random.default_rng(3)
    solids = RoundedSolids([obstacle(kind, rng) for kind in ROUNDED for _ in range(8)])
    circles = some_circles(rng, len(solids.ball))
    distance = nearest(circles, solids).distance
    for i in range(len(distance)):
        for shift, below in ((2.0 * ERROR, True), (-2.0 * ERROR, False), (0.05, True), (-0.05, False)):
            limits = distance - 0.01
            limits[i] = distance[i] + shift
            assert (nearest(circles, solids, limits).distance < limits).any() == below


@pytest.mark.parametrize("parts", [3, 8, 32])
def test_no_point_of_an_arc_is_below_its_bound(parts: int) -> None:
    """The statements from which the search proves its result, and that the bounds are of second order."""
    rng = np.random.default_rng(parts)
    solids = RoundedSolids([obstacle(kind, rng) for kind in ROUNDED for _ in range(40)])
    circles = some_circles(rng, len(solids.ball))
    ends = np.linspace(0.0, 2.0 * np.pi, parts + 1)[None].repeat(len(solids.ball), axis=0)
    at, half_angle = on_circle(circles, ends), np.pi / parts
    value, gradient = solids.measure(circles.body, at)
    convex = _from_convex(value, at - circles.centre[..., None], gradient, half_angle)
    bound = np.where(solids.convex[:, None], convex, _from_torus(value, circles.radius, half_angle))
    between = np.linspace(0.0, 2.0 * np.pi, 40 * parts + 1)[None].repeat(len(solids.ball), axis=0)
    dense_value, _ = solids.measure(circles.body, on_circle(circles, between))
    chunks = np.stack([dense_value[:, k : k + 40 * parts : 40] for k in range(40)])
    gap = chunks.min(axis=0) - bound
    assert gap.min() > -1e-12
    radius, away = circles.radius[:, None], np.minimum(value[:, :-1], value[:, 1:])
    far = away > 2.0 * half_angle * radius
    curvature = radius + radius**2 / np.maximum(away, 1e-9)
    assert (gap / (half_angle**2 * curvature))[far].max() < 1.0


def test_alone_and_among_others_the_result_is_the_same() -> None:
    """To the last bit: plans must not depend on what is computed together."""
    rng = np.random.default_rng(5)
    solids = RoundedSolids([obstacle(kind, rng) for kind in ROUNDED for _ in range(10)])
    circles = some_circles(rng, len(solids.ball))
    together = nearest(circles, solids)
    for i in range(len(solids.ball)):
        one = slice(i, i + 1)
        own = Circles(
            circles.centre[:, one],
            circles.x[:, one],
            circles.y[:, one],
            circles.radius[one],
            circles.body[one],
        )
        alone = nearest(own, solids)
        assert alone.distance[0] == together.distance[i]
        assert np.array_equal(alone.point[:, 0], together.point[:, i])
        assert np.array_equal(alone.away[:, 0], together.away[:, i])
