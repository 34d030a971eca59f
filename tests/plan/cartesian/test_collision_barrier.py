"""Barriers: rows are the derivative of the distance; a line bends its free yaw around a box, or says what stops it."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Sphere
from arm.se3 import transform
from plan.cartesian.collision_barrier import collision_barrier
from plan.collision.world import World
from plans.barred_lines import start_above, with_post


def test_rows_are_the_derivative_of_the_distance(robot: Robot, unit: Unit) -> None:
    rng = np.random.default_rng(21)
    world, count = with_post(robot), 0
    barrier = collision_barrier(world, 0.0, 0.08)
    for q in rng.uniform(unit.lower, unit.upper, (80, 6)):
        here = barrier(q)
        dq = rng.normal(size=6)
        step = 1e-5 * dq / np.linalg.norm(dq)
        ahead, behind = barrier(q + step), barrier(q - step)
        for row, name in enumerate(here.names):
            if (
                abs(here.h[row]) < 1e-3
                or here.h[row] < -0.02
                or name not in ahead.names
                or name not in behind.names
            ):
                continue
            change = (ahead.h[ahead.names.index(name)] - behind.h[behind.names.index(name)]) / 2e-5
            assert -here.G[row] @ step / 1e-5 == pytest.approx(change, abs=0.02)
            count += 1
    assert count > 50


@pytest.mark.few(6)
@pytest.mark.parametrize("padding", [0.0, 0.012])
@pytest.mark.parametrize("signed", [-0.008, -0.002, 0.0, 0.002, 0.008])
def test_rows_point_apart_in_overlap_and_within_the_padding(
    robot: Robot, unit: Unit, signed: float, padding: float
) -> None:
    """A ball in or beside the hand: following its row takes the two apart, as the distance's own differences do."""
    rng, count = np.random.default_rng(22), 0
    for q in rng.uniform(unit.lower, unit.upper, (12, 6)):
        ball = _ball_beside_a_finger(robot, q, signed, rng)
        world = World(robot, [ball], padding=padding)
        barrier = collision_barrier(world, 0.0, 0.05)(q)
        for name, row, value in zip(barrier.names, barrier.G, barrier.h, strict=True):
            index = [i for i in range(len(world.pairs)) if " / ".join(world.pair_names(i)) == name]
            if not name.endswith("/ ball") or not -0.01 <= value + padding <= 0.01:
                continue
            step = -1e-4 * row / np.linalg.norm(row)
            ahead, behind = (world.pair_distances(q + x, np.array(index))[0] for x in (step, -step))
            assert (ahead - behind) / 2e-4 == pytest.approx(np.linalg.norm(row), rel=0.05), name
            count += 1
    assert count >= 10


def _ball_beside_a_finger(robot: Robot, q: np.ndarray, signed: float, rng: np.random.Generator) -> Body:
    """A ball of 15 mm whose distance from a finger is `signed` m, negative for overlap."""
    finger = next(b for b in robot.bodies_at(q) if b.name.startswith("finger"))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    middle = finger.T_base_body[:3, 3] + 0.2 * direction
    for _ in range(4):  # along the normal until it fits
        ball = Body("ball", Sphere(0.015), transform(t=middle), "wall")
        world = World(robot, [ball])
        pair = next(i for i in range(len(world.pairs)) if world.pair_names(i) == (finger.name, "ball"))
        found = world.witnesses(q[None], np.zeros(1, dtype=np.intp), np.array([pair]))
        middle = middle + (found.distance[0] - signed) * found.normal[0]
    return ball


def test_rows_of_bodies_that_touch_are_the_derivative_too(robot: Robot, crs97: Unit) -> None:
    q = start_above(robot, crs97, 0.0)
    # a wall moved until its face is where the foremost body ends
    far = World(robot, [Body("wall", Box((0.04, 2.0, 2.0)), transform(t=(1.02, 0.0, 0.0)), "wall")])
    gap = far.distances_below(q, 10.0)
    gap = next(d.value for d in gap if "wall" in d.pair)
    world = World(robot, [Body("wall", Box((0.04, 2.0, 2.0)), transform(t=(1.02 - gap, 0.0, 0.0)), "wall")])
    barrier = collision_barrier(world, 0.0, 0.001)(q)
    row = next(i for i, n in enumerate(barrier.names) if n.endswith("/ wall"))
    assert abs(barrier.h[row]) < 1e-6
    T = robot.T_base_tool(q)
    # moving the tool straight along x (no turning) is what the row counts
    dq = np.linalg.lstsq(robot.jacobian(q), np.r_[T[:3, :3].T @ (1.0, 0.0, 0.0), 0, 0, 0], rcond=None)[0]
    assert barrier.G[row] @ dq == pytest.approx(1.0, abs=1e-3)
