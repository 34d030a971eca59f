"""The two halves of the broadphase together answer what the distances of all pairs answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.robot.shapes import Body, Box, Sphere
from arm.se3 import frozen, transform
from arms.around import bodies_around, one_ball, some_q
from arms.grazing import ARMS, arm
from plan.collision.world import World

CLEARANCES = (0.005, -0.01, 0.06, 0.0)


def agree(world: World, configurations: int) -> int:
    """Compare with the least distance, for clearances in turn; return how many of the configurations are too near."""
    rng = np.random.default_rng(7)
    every, near = np.arange(len(world.pairs)), 0
    for i, q in enumerate(some_q(world, rng, configurations)):
        least = float(world.pair_distances(q, every).min())
        clearance = CLEARANCES[i % len(CLEARANCES)]
        if abs(least - clearance) > 1e-6:
            assert world.in_collision(q, clearance) == (least < clearance)
            near += least < clearance
    return near


@pytest.mark.few(2)
@pytest.mark.parametrize("count", [1, 6, 80])
@pytest.mark.parametrize("name", ARMS)
def test_too_near_is_what_distances_say(name: str, count: int) -> None:
    rng = np.random.default_rng(count)
    bodies = [replace(body, padding=float(rng.uniform(0.0, 0.02))) for body in bodies_around(rng, count)]
    robot = arm(name)
    held = Body("held", Box((0.05, 0.05, 0.05)), frozen(np.eye(4)), "cube", padding=0.01)
    world = World(robot, bodies, held, np.eye(4), allowed=[frozenset(("held", bodies[0].name))])
    assert 10 < agree(world, 160) <= 160


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("base", [False, True])
def test_one_moving_body_is_enough(tmp_path: Path, base: bool, count: int) -> None:
    """Boxes of bodies are inflated by the margins of pairs of moving bodies, of which there are none here."""
    still = [
        Body(
            f"still {i}",
            Sphere(0.02),
            transform(t=(0.3 * np.cos(2.0 * i), 0.3 * np.sin(2.0 * i), 0.0)),
            "wall",
        )
        for i in range(count)
    ]
    assert agree(World(one_ball(tmp_path, base), still), 200) > 5


def test_a_distance_after_collision_checks_is_the_same() -> None:
    """Both use the same placements and requests of their own."""
    rng = np.random.default_rng(3)
    world = World(arm("open"), bodies_around(rng, 5))
    every = np.arange(len(world.pairs))
    qs = some_q(world, rng, 20)
    before = [world.pair_distances(q, every) for q in qs]
    for q in qs:
        world.in_collision(q, 0.01)
    assert np.array_equal(before, [world.pair_distances(q, every) for q in qs])
