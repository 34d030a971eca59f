"""MotionBenchMaker's problems and VAMP's Panda of spheres, from a folder that is not part of the project."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.controller.unit import Limits
from arm.numerics.products import nearest_rotation
from arm.robot.model import Robot, load_robot
from arm.robot.shapes import Body, Box, Cylinder, Shape, Sphere
from arm.se3 import Array, frozen

SETS = (
    "table_pick",
    "table_under_pick",
    "box",
    "bookshelf_small",
    "bookshelf_tall",
    "bookshelf_thin",
    "cage",
)
URDF, SRDF, HAND = "panda_spherized.urdf", "panda.srdf", "panda_hand"
# of the measurements that the data's SOURCES.md states, rad/s and rad/s^2
_VELOCITY = np.array([2.175] * 4 + [2.61] * 3)
_ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])


@dataclass(frozen=True)
class Problem:
    """One problem: still bodies, start and goal (7,) rad."""

    number: int
    bodies: tuple[Body, ...]
    q_start: Array
    q_goal: Array


def panda(folder: Path) -> tuple[Robot, Limits]:
    """Return the arm and its limits."""
    robot = load_robot(folder / URDF, HAND, np.eye(4), srdf=folder / SRDF)
    model = robot.model
    return robot, Limits(model.lowerPositionLimit, model.upperPositionLimit, _VELOCITY, _ACCELERATION)


def problems(folder: Path, name: str, count: int) -> Iterator[Problem]:
    """Yield the first `count` problems of a set."""
    for found in json.loads((folder / f"{name}.json").read_text())["problems"][:count]:
        bodies = tuple(
            _body(b["name"], b["type"], b["dimensions"], np.array(b["T"])) for b in found["bodies"]
        )
        yield Problem(found["number"], bodies, frozen(found["q_start"]), frozen(found["q_goal"]))


def _body(name: str, kind: str, sizes: list[float], T: Array) -> Body:
    T[:3, :3] = nearest_rotation(T[:3, :3])  # the files round to nine digits
    match kind:
        case "box":
            shape: Shape = Box((sizes[0], sizes[1], sizes[2]))
        case "cylinder":
            shape = Cylinder(sizes[1], sizes[0])
        case "sphere":
            shape = Sphere(sizes[0])
        case other:
            raise ValueError(f"{name}: no shape for {other!r}")
    return Body(name, shape, frozen(T), "obstacle")
