"""Worlds and curves through them."""

from __future__ import annotations

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import load_unit
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box, Cylinder
from arm.se3 import Array, frozen, rotation, transform
from plan.collision.bezier import Curve
from plan.collision.world import World
from tasks.task2 import POST, TABLE, TOOL_LENGTH

HELD = Body("held", Box((0.04, 0.04, 0.04)), frozen(np.eye(4)), "cube")

UNIT = load_unit("crs93")


def crowded_world(rng: np.random.Generator) -> World:
    bodies = [TABLE, POST]
    for i in range(6):
        angle = rng.uniform(-2.5, 2.5)
        place = np.array([0.65 * np.cos(angle), 0.65 * np.sin(angle), 0.25]) + rng.uniform(-0.15, 0.15, 3)
        x, y, z = (float(v) for v in rng.uniform(0.02, 0.25, 3))
        shape = Box((x, y, z)) if i % 2 else Cylinder(x / 2, z)
        bodies.append(Body(f"body {i}", shape, transform(rotation(rng.normal(size=3)), place), "wall"))
    return World(load_a465(TOOL_LENGTH, 0.04), bodies, HELD, transform(t=(0.0, 0.0, 0.003)))


def at(curve: Curve, u: Array) -> Array:
    """Configurations (m, n) of a one-piece curve."""
    weights = np.stack([(1 - u) ** 3, 3 * u * (1 - u) ** 2, 3 * u**2 * (1 - u), u**3], axis=1)
    return np.asarray(weights @ curve.control[0])


def count_path(rng: np.random.Generator, start: Array, orders: tuple[int, ...]) -> CountPath:
    segments = tuple(
        Segment(
            int(rng.integers(40, 400)),
            tuple(tuple(int(v) for v in rng.integers(-4000, 4000, 6)) for _ in range(order)),
        )
        for order in orders
    )
    return CountPath(tuple(int(c) for c in UNIT.counts(start)), segments)
