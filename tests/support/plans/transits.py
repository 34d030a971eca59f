"""Transits around walls."""

from __future__ import annotations

from arm.robot.model import load_a465
from arm.robot.shapes import Body
from plan.collision.world import World
from tasks.task2 import POST, TABLE, TOOL_LENGTH

ROBOT = load_a465(TOOL_LENGTH, 0.06)


def world_with(*bodies: Body) -> World:
    return World(ROBOT, [TABLE, POST, *bodies])
