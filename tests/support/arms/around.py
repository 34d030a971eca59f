"""Bodies around an arm, configurations of it, and points of bodies."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm.robot.model import Robot, load_robot
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Shape, Sphere, Torus
from arm.se3 import Array, rotation, transform
from arms.grazing import OBSTACLES, obstacle
from plan.collision.world import World

KINDS = [kind for kind in OBSTACLES if kind != "self"]


def bodies_around(rng: np.random.Generator, count: int) -> list[Body]:
    bodies = []
    for i in range(count):
        angle = rng.uniform(-np.pi, np.pi)
        place = np.array([0.6 * np.cos(angle), 0.6 * np.sin(angle), 0.4]) + rng.uniform(-0.3, 0.3, 3)
        turn = rotation(rng.normal(size=3)) if i % 3 else np.eye(3)
        bodies.append(Body(f"body {i}", obstacle(KINDS[i % len(KINDS)], rng), transform(turn, place), "wall"))
    return bodies


def some_q(world: World, rng: np.random.Generator, count: int) -> Array:
    model = world.robot.model
    return np.asarray(rng.uniform(model.lowerPositionLimit, model.upperPositionLimit, (count, model.nq)))


def surface(shape: Shape, rng: np.random.Generator, count: int) -> Array:
    """Points (count, 3) of a body's surface, many of them at its corners and rims."""
    v = rng.normal(size=(count, 3))
    v /= np.linalg.norm(v, axis=1)[:, None]
    match shape:
        case Box(size):
            return np.asarray(rng.choice([-1.0, 0.3, 1.0], (count, 3)) * np.array(size) / 2.0)
        case Cylinder(radius, length):
            around = v[:, :2] / np.linalg.norm(v[:, :2], axis=1)[:, None] * radius
            return np.column_stack([around, rng.choice([-0.5, 0.2, 0.5], count) * length])
        case Capsule(radius, length):
            return np.asarray(radius * v + np.sign(v[:, 2:]) * (0.0, 0.0, length / 2.0))
        case Sphere(radius):
            return np.asarray(radius * v)
        case Torus(radius, tube):
            around = v[:, :2] / np.linalg.norm(v[:, :2], axis=1)[:, None] * radius
            out = np.roll(v, 1, axis=0)
            return np.asarray(np.column_stack([around, np.zeros(count)]) + tube * out)
        case Convex(points):
            weights = rng.dirichlet(np.full(len(points), 0.05), count)
            return np.asarray(weights @ np.array(points))


def one_ball(folder: Path, base: bool) -> Robot:
    """An arm of one joint whose only moving body is a ball at 0.3 m."""
    ball = '<collision><origin xyz="{} 0 0"/><geometry><sphere radius="0.02"/></geometry></collision>'
    text = (
        f'<robot name="one"><link name="l0">{ball.format(-0.1) if base else ""}</link>'
        f'<link name="l1">{ball.format(0.3)}</link><joint name="q1" type="revolute">'
        '<parent link="l0"/><child link="l1"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>'
    )
    path = folder / "one.urdf"
    path.write_text(text)
    return load_robot(path, "l1", np.eye(4))
