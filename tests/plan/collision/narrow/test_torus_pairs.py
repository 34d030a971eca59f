"""Distances of tori against coal's distances of many capsules, and what must not change them."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.robot.model import LinkBody
from arm.robot.shapes import Body, Box, Capsule, Convex, Sphere, Torus
from arm.se3 import Array, inverse, rot_x, rot_z, rotation, transform
from arms.around import KINDS
from arms.grazing import obstacle
from arms.hoop import as_capsules
from cell.program.planning import program_scene
from cell.program.program_file import read_program
from plan.collision.narrow.circle import ERROR
from plan.collision.narrow.solids import HullSolids, RoundedSolids
from plan.collision.narrow.torus_pairs import covered, torus_distance
from plan.collision.world import DISTANCE_ERROR, UNKNOWN_DEPTH, World, distance_of
from vision.observation import Observation

PARTS = 240  # capsules that stand for a torus
HALF_ANGLE = np.pi / PARTS
OTHERS = [kind for kind in KINDS if kind != "torus"]


def some_torus(rng: np.random.Generator) -> Body:
    shape = Torus(float(rng.uniform(0.02, 0.1)), float(rng.uniform(0.003, 0.015)))
    return Body("torus", shape, pose(rng, 0.05), "tool")


def pose(rng: np.random.Generator, reach: float) -> Array:
    return transform(rotation(rng.normal(size=3)), rng.uniform(-reach, reach, 3))


def pairs(rng: np.random.Generator, count: int, kinds: list[str]) -> list[tuple[Body, Body]]:
    """Tori and bodies of every kind, from interlocked to 0.3 m apart."""
    return [
        (some_torus(rng), Body("other", obstacle(kinds[i % len(kinds)], rng), pose(rng, reach), "wall"))
        for i, reach in enumerate(rng.choice([0.01, 0.1, 0.3], count))
    ]


def test_distances_are_those_of_capsules_along_the_circle() -> None:
    """By coal; where bodies overlap only that they do."""
    apart = overlaps = 0
    for torus, other in pairs(np.random.default_rng(1), 63, OTHERS):
        found = distance_of(torus, other).value
        wanted = min(distance_of(part, other).value for part in as_capsules(torus, PARTS))
        assert (found < 0.0) == (wanted < 0.0)
        if wanted > 0.0:
            assert abs(found - wanted) < 0.1 * HALF_ANGLE**2 / 4.0 + DISTANCE_ERROR
            apart += 1
        else:
            overlaps += 1
    assert apart > 25
    assert overlaps > 12


def test_two_tori_are_as_far_apart_as_their_capsules() -> None:
    """Both made of capsules, and their distances all computed by coal: linked, side by side, one in the other."""
    rng = np.random.default_rng(2)
    linked = 0
    for i in range(12):
        one, two = some_torus(rng), some_torus(rng)
        if i % 2:  # the second through the middle of the first, across it
            through = transform(rot_x(np.pi / 2.0), (vars(two.shape)["radius"], 0.0, 0.0))
            two = two.at(one.T_base_body @ through @ transform(rotation(rng.normal(size=3) * 0.2)))
        found = distance_of(one, two).value
        # the capsules of the second that come near each of the first
        mine, theirs = as_capsules(one, PARTS), as_capsules(two, PARTS)
        at = [np.array([part.T_base_body[:3, 3] for part in parts]) for parts in (mine, theirs)]
        apart = np.linalg.norm(at[0][:, None] - at[1], axis=2)
        near = np.argwhere(apart < apart.min() + 0.003)
        wanted = min(distance_of(mine[i], theirs[j]).value for i, j in near.tolist())
        if wanted > 0.0:
            assert abs(found - wanted) < 0.2 * HALF_ANGLE**2 / 4.0 + DISTANCE_ERROR
            linked += links(one, two)
        else:
            assert found < 0.0
    assert linked >= 2


def links(one: Body, two: Body) -> bool:
    """Whether the circle of one passes the disc of the other an odd number of times."""
    assert isinstance(one.shape, Torus)
    assert isinstance(two.shape, Torus)
    angles = np.linspace(0.0, 2.0 * np.pi, 1001)
    circle = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles, 1.0 / two.shape.radius + 0.0 * angles])
    x, y, z, _ = inverse(one.T_base_body) @ two.T_base_body @ circle * two.shape.radius
    through = np.flatnonzero(z[1:] * z[:-1] < 0.0)
    return bool((np.hypot(x, y)[through] < one.shape.radius).sum() % 2)


@pytest.mark.parametrize("height", [0.0, 0.05, -0.03])
def test_a_torus_around_a_capsule_on_its_axis(height: float) -> None:
    ring = Body("ring", Torus(0.0324, 0.0048), transform(t=(0.3, 0.0, 0.2)), "tool")
    rod = Body("rod", Capsule(0.005, 0.2), transform(t=(0.3, 0.0, 0.2 + height)), "wall")
    assert distance_of(ring, rod).value == pytest.approx(0.0324 - 0.0048 - 0.005, abs=1e-12)
    ball = Body("ball", Sphere(0.005), transform(t=(0.3, 0.0, 0.2 + height)), "wall")
    assert distance_of(ring, ball).value == pytest.approx(np.hypot(0.0324, height) - 0.0098, abs=1e-12)
    post = Body("post", Box((0.01, 0.01, 0.2)), rod.T_base_body, "wall")
    assert distance_of(ring, post).value == pytest.approx(0.0276 - 0.005 * np.sqrt(2.0), abs=ERROR)


def test_where_the_two_bodies_are_and_which_comes_first_does_not_matter() -> None:
    """Nor by how much the torus is turned about its own axis."""
    rng = np.random.default_rng(3)
    for torus, other in pairs(rng, 60, KINDS):
        error = 2.0 * (ERROR + (HullSolids.error if isinstance(other.shape, Convex) else RoundedSolids.error))
        found = distance_of(torus, other)
        moved = pose(rng, 1.0)
        away = distance_of(torus.at(moved @ torus.T_base_body), other.at(moved @ other.T_base_body))
        assert away.value == pytest.approx(found.value, abs=error)
        turned = torus.at(torus.T_base_body @ transform(rot_z(float(rng.uniform(-3.0, 3.0)))))
        assert distance_of(turned, other).value == pytest.approx(found.value, abs=error)
        swapped = distance_of(other, torus)
        assert swapped.value == pytest.approx(found.value, abs=error)
        assert swapped.pair == found.pair[::-1]


def test_witness_points_are_on_both_bodies_and_that_far_apart() -> None:
    rng = np.random.default_rng(4)
    for torus, other in pairs(rng, 80, KINDS):
        for inner, outer in ((torus, other), (other, torus)):
            found = torus_distance(inner, outer)
            assert np.linalg.norm(found.normal) == pytest.approx(1.0, abs=1e-6)
            between = found.outer - found.inner
            assert between == pytest.approx(found.min_distance * found.normal, abs=1e-9)
            for body, point, out in ((inner, found.inner, 2e-4), (outer, found.outer, -2e-4)):
                mark = Body("mark", Sphere(1e-4), transform(t=point + out * found.normal), "mark")
                if found.min_distance > 1e-3:
                    assert distance_of(body, mark).value == pytest.approx(1e-4, abs=DISTANCE_ERROR)


def test_the_depth_is_that_of_the_deepest_point_of_the_circle() -> None:
    box = Body("box", Box((1.0, 1.0, 0.1)), transform(t=(0.0, 0.0, 0.0)), "wall")
    for height in (0.054, 0.05, 0.03, -0.02):
        ring = Body("ring", Torus(0.03, 0.005), transform(t=(0.0, 0.0, height)), "tool")
        assert distance_of(ring, box).value == pytest.approx(abs(height) - 0.05 - 0.005, abs=1e-12)


def test_covering_capsules_contain_a_torus_and_thinner_ones_are_inside() -> None:
    rng = np.random.default_rng(5)
    torus, other = some_torus(rng), Body("other", Box((0.1, 0.02, 0.3)), transform(t=(0.2, 0.0, 0.0)), "wall")
    assert isinstance(torus.shape, Torus)
    parts = [LinkBody(body.name, 0, body.shape, body.T_base_body) for body in (other, torus)]
    found = covered(parts, np.array([[0, 1], [0, 0]]), np.array([0.01, 0.02]))
    assert sorted(found.pairs.tolist()) == [[0, 0], *([0, i] for i in range(1, len(found.parts)))]
    assert sorted(set(found.paddings.tolist())) == [0.01, 0.02]
    assert found.parts[0].shape == other.shape
    assert np.array_equal(found.parts[0].T_joint_body, other.T_base_body)
    angles = rng.uniform(0.0, 2.0 * np.pi, 3000)
    circle = torus.shape.radius * np.array([np.cos(angles), np.sin(angles), 0.0 * angles])
    points = torus.T_base_body[:3, :3] @ circle + torus.T_base_body[:3, 3:]
    away = np.full(len(angles), np.inf)
    for part in found.parts[1:]:
        assert isinstance(part.shape, Capsule)
        assert part.shape.radius == pytest.approx(torus.shape.tube + found.excess, abs=1e-12)
        x, y, z = part.T_joint_body[:3, :3].T @ (points - part.T_joint_body[:3, 3:])
        over = np.maximum(np.abs(z) - part.shape.length / 2.0, 0.0)
        away = np.minimum(away, np.sqrt(x * x + y * y + over * over))
    # from the middle lines of the capsules, all along the circle
    assert away.max() <= found.excess + 1e-12
    assert away.max() > 0.9 * found.excess
    assert found.excess < 0.003 * torus.shape.radius


def test_distances_of_many_configurations_are_those_of_each() -> None:
    """Value, normal and point on the outer body, of tori and others in one list, in the order of the pairs."""
    task = read_program(data_file("scenes/hoop/b.toml"))
    scene = program_scene(task, Observation())
    world = World(scene.robot_open, scene.bodies)
    rng, every = np.random.default_rng(5), np.arange(len(world.pairs))
    q = task.cell.q_start + 0.2 * rng.normal(size=(4, 6))
    rows = np.repeat(np.arange(4), len(every))
    found = world.witnesses(q, rows, np.tile(every, 4))
    torus = np.array([isinstance(p.shape, Torus) for p in world._parts])[world.pairs].any(axis=1)
    assert 0 < torus.sum() < len(every)
    for row, at in enumerate(q):
        one = [
            (r.min_distance, np.array(r.normal), np.array(r.getNearestPoint2()))
            for r in world._geometry.distances(at, every)
        ]
        here = rows == row
        values, normals, points = (np.array(column) for column in zip(*one, strict=True))
        np.testing.assert_allclose(
            found.distance[here], np.maximum(values, UNKNOWN_DEPTH) - world.paddings, atol=1e-12
        )
        np.testing.assert_allclose(found.normal[here][torus], normals[torus], atol=1e-12)
        np.testing.assert_allclose(found.point[here][torus], points[torus], atol=1e-12)
    # the list ends with the first distance below a limit, be that of a torus or not
    for order in (np.argsort(torus), np.argsort(~torus)):
        tried = np.tile(every[order], 4)
        whole = world.witnesses(q, rows, tried)
        least = float(whole.distance[0]) + 1e-6
        first = int(np.flatnonzero(whole.distance < least)[0])
        stopped = world.witnesses(q, rows, tried, least)
        np.testing.assert_array_equal(stopped.distance, whole.distance[: first + 1])
