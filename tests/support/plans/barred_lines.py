"""Lines of the tool beside bodies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.controller.unit import Limits, Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Cylinder
from arm.se3 import rot_x, rot_z, transform
from plan.collision.world import World
from plan.kinematics.ik import inverse_kinematics

START = transform(rot_x(np.pi), (0.40, -0.10, 0.08))


def with_post(robot: Robot, x: float = 0.45) -> World:
    """A post beside the line: fingers across it do not pass, fingers along it do."""
    post = Body("post", Box((0.04, 0.04, 0.2)), transform(t=(x + 0.02, 0.0, 0.1)), "wall")
    return World(robot, [post])


def start_above(robot: Robot, unit: Unit, yaw: float) -> np.ndarray:
    T = START @ transform(rot_z(yaw))
    found = inverse_kinematics(robot, T, unit.lower, unit.upper).q
    room = np.minimum(found - unit.lower, unit.upper - found).min(axis=1)
    return np.asarray(found[np.argmax(np.round(room, 6))])


GRASP = transform(rot_x(np.pi), (0.46, 0.11, 0.05))


def up(T: np.ndarray, distance: float) -> np.ndarray:
    return transform(T[:3, :3], T[:3, 3] - distance * T[:3, 2])


def start_at(robot: Robot, unit: Unit, T: np.ndarray = GRASP) -> np.ndarray:
    return np.asarray(inverse_kinematics(robot, T, unit.lower, unit.upper).q[0])


def hole_scene(seed: int) -> tuple[np.ndarray, list[Body]]:
    """A hole (3,) m to which a tool comes straight down: a low plate beside it, and a post that hangs beside the way.

    The hand passes the post with one yaw, and stands beside the plate with another.
    """
    rng = np.random.default_rng([1, seed])
    radius, azimuth = rng.uniform(0.38, 0.52), rng.uniform(-1.2, 1.2)
    at = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), rng.uniform(0.02, 0.10)])
    beside = rng.uniform(-np.pi, np.pi)
    above = beside + rng.choice([-1, 1]) * rng.uniform(0.8, np.pi / 2)
    plate_at = at + (rng.uniform(0.034, 0.044) + 0.003) * towards(beside)
    post_at = at + (rng.uniform(0.042, 0.046) + 0.012) * towards(above)
    plate_at[2] += rng.uniform(0.005, 0.03) - 0.025
    post_at[2] += rng.uniform(0.075, 0.12) + 0.03
    return at, [
        Body("plate", Box((0.006, 0.16, 0.05)), transform(rot_z(beside), plate_at), "wall"),
        Body("post", Cylinder(0.012, 0.06), transform(t=post_at), "wall"),
    ]


def towards(angle: float) -> np.ndarray:
    """A horizontal unit vector (3,)."""
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def clear_starts(
    world: World, limits: Limits, poses: Sequence[np.ndarray], clearance: float
) -> list[np.ndarray]:
    """All clear solutions at some poses, the one with the most room to the joint limits first."""
    found = inverse_kinematics(world.robot, np.stack(poses), limits.lower, limits.upper).q
    clear = [q for q in found if not world.in_collision(q, clearance)]
    return sorted(clear, key=lambda q: -round(float(np.minimum(q - limits.lower, limits.upper - q).min()), 6))
