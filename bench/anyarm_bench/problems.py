"""Seeded problems: bodies around an arm, where it stands, and two poses that it can reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anyarm_bench.arms import load
from arm.robot.shapes import Body, Box, Cylinder, Shape, Sphere
from arm.se3 import Array, rotation, transform
from plan.collision.world import World

BODIES = 10
SIZE = 0.04, 0.2  # m, of each edge
NEAR, FAR, HIGH = 0.3, 0.75, 0.8  # m, where bodies stand: distance from the base's axis, height
CLEAR = 0.02  # m, of the start and of a solution for each pose
BLOCKED = 40  # samples of a straight joint move, one of which is in collision
TABLE = Body("table", Box((2.0, 2.0, 0.04)), transform(t=(0.0, 0.0, -0.05)), "table")


@dataclass(frozen=True, eq=False)
class Problem:
    """One problem.

    Attributes:
        arm: its name.
        seed: it.
        bodies: around the arm.
        q_start: (n,) rad, clear.
        poses: T_base_tool (4, 4) of each target; each is the tool's at a configuration that is clear, and the straight
            joint moves from one such configuration to the next are blocked.
    """

    arm: str
    seed: int
    bodies: tuple[Body, ...]
    q_start: Array
    poses: tuple[Array, ...]


def draw(arm: str, seed: int, targets: int = 2) -> Problem:
    """The problem of a seed."""
    robot, limits = load(arm)
    rng = np.random.default_rng([seed, *arm.encode()])
    low, high = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    while True:
        bodies = (TABLE, *(_body(rng, i) for i in range(BODIES)))
        world = World(robot, bodies)
        stands: list[Array] = []
        for _ in range(2000):
            q = rng.uniform(low, high)
            if world.in_collision(q, CLEAR):
                continue
            if not stands or _blocked(world, stands[-1], q):
                stands.append(q)
            if len(stands) == 1 + targets:
                return Problem(arm, seed, bodies, stands[0], tuple(robot.T_base_tool(q) for q in stands[1:]))


def _body(rng: np.random.Generator, number: int) -> Body:
    a, b, c = rng.uniform(*SIZE, 3).tolist()
    shapes: tuple[Shape, ...] = (Box((a, b, c)), Cylinder(a / 2, b), Sphere(a / 2))
    radius, angle = rng.uniform(NEAR, FAR), rng.uniform(-np.pi, np.pi)
    place = (radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.0, HIGH))
    return Body(f"body {number}", shapes[number % 3], transform(rotation(rng.normal(size=3)), place), "box")


def _blocked(world: World, a: Array, b: Array) -> bool:
    return any(world.in_collision(a + u * (b - a)) for u in np.linspace(0.0, 1.0, BLOCKED))
