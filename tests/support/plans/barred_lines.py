"""Lines of the tool beside bodies."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
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
