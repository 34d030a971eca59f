"""Transits around walls, and through a window."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np

from arm.controller.unit import Limits, load_unit
from arm.io.storage import data_file
from arm.robot.model import Robot, load_a465, load_robot
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, transform
from plan.collision.world import World
from plan.kinematics.ik import inverse_kinematics
from tasks.task2 import POST, Q_START, TABLE, TOOL_LENGTH

ROBOT = load_a465(TOOL_LENGTH, 0.06)

UNIT = load_unit("crs93")

LIMITS = UNIT.limits().scaled(0.5)

RIGHT = np.array(Q_START)

LEFT = RIGHT * np.array([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0])

# across the straight way, lower than the arm can go over
LOW_WALL = Body("wall", Box((0.3, 0.02, 0.3)), transform(t=(0.45, 0.0, 0.15)), "wall")

WINDOW_START = frozen(np.radians([90.0, 0.0, -45.0, 0.0, -45.0, 0.0]))
_HAND = (0.10, 0.06, 0.10)  # m, across and along the tool
_WALL_X, _WINDOW_Z, _THICK, _BEHIND = 0.42, 0.45, 0.02, 0.10  # m
_WALL_WIDTH = 1.2  # m


def world_with(*bodies: Body) -> World:
    return World(ROBOT, [TABLE, POST, *bodies])


def near_limits(rng: np.random.Generator) -> Limits:
    """Limits that leave the straight way from `RIGHT` to `LEFT`, and hardly more on some sides."""
    low, high = np.minimum(RIGHT, LEFT), np.maximum(RIGHT, LEFT)
    room = np.where(rng.random((2, 6)) < 0.3, 0.05, 1.2)
    lower, upper = np.maximum(low - room[0], UNIT.lower), np.minimum(high + room[1], UNIT.upper)
    return Limits(lower, upper, LIMITS.velocity, LIMITS.acceleration)


def inside(corners: Array, limits: Limits) -> Array:
    """Which of corners (m, c, n) are within limits, all of them."""
    return np.asarray(((corners >= limits.lower) & (corners <= limits.upper)).all(axis=(1, 2)))


def arm_with_hand() -> Robot:
    """The A465 with one box as its hand, 10 x 6 cm across and 10 cm long."""
    path = data_file("urdf/a465/a465.urdf")
    root = ElementTree.fromstring(path.read_text())
    gone = {"gripper", "palm", "finger_l", "finger_r"}
    for element in list(root):
        child = element.find("child")
        if element.get("name") in gone or (child is not None and child.get("link") in gone):
            root.remove(element)
    flange = next(link for link in root.findall("link") if link.get("name") == "flange")
    collision = ElementTree.SubElement(flange, "collision")
    ElementTree.SubElement(collision, "origin", {"xyz": f"0 0 {_HAND[2] / 2}"})
    box = ElementTree.SubElement(ElementTree.SubElement(collision, "geometry"), "box")
    box.set("size", " ".join(map(str, _HAND)))
    tool, text = transform(t=(0.0, 0.0, _HAND[2])), ElementTree.tostring(root, encoding="unicode")
    return load_robot(path, "flange", tool, srdf=path.with_suffix(".srdf"), text=text)


def wall_with_window(size: float) -> list[Body]:
    """A wall on the table, across x, with a square window in it."""
    half, top, side = size / 2, _WINDOW_Z + _WALL_WIDTH / 2, _WALL_WIDTH / 2
    spans = {
        "left": (half, side, 0.0, top),
        "right": (-side, -half, 0.0, top),
        "below": (-half, half, 0.0, _WINDOW_Z - half),
        "above": (-half, half, _WINDOW_Z + half, top),
    }
    return [
        Body(
            f"wall {name}",
            Box((_THICK, y1 - y0, z1 - z0)),
            transform(t=(_WALL_X, (y0 + y1) / 2, (z0 + z1) / 2)),
            "wall",
        )
        for name, (y0, y1, z0, z1) in spans.items()
    ]


def through_window(robot: Robot, size: float, clearance: float) -> tuple[World, list[Array]]:
    """The world with a window, and configurations (6,) of the hand 100 mm behind the wall that have the clearance, m.

    The tool's z axis is along +x; the hand lies flat or on edge.
    """
    world = World(robot, [TABLE, *wall_with_window(size)])
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 2] = 1.0, 0.0, 0.0
    poses[:, :3, 1] = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    poses[:, :3, 0] = np.cross(poses[:, :3, 1], poses[:, :3, 2])
    poses[:, :3, 3] = _WALL_X + _THICK / 2 + _BEHIND, 0.0, _WINDOW_Z
    found = inverse_kinematics(robot, poses, LIMITS.lower, LIMITS.upper).q
    return world, [frozen(q) for q in found if not world.in_collision(q, clearance)]
