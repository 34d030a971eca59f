"""The arm file (TOML): any arm from its URDF, its tool, where it starts, and the bodies around it; for lists of poses.

docs/adding.md has the keys. Positions of joints are in rad, or in m where a joint slides, as in URDF and SRDF.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm.controller.unit import Limits
from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import flag, is_number, line, number, numbers, path, rule_of, same, table, tables
from arm.robot.description import joint_motion
from arm.robot.model import Robot, load_robot
from arm.robot.shapes import Body
from arm.robot.tool import urdf_limits, with_disabled_collisions, with_tool
from arm.se3 import Array
from cell.config.bodies import ON_FLANGE, TURN, pose_of, read_body
from cell.config.inputs import Inputs, config_inputs
from plan.options import LEAST_CLEARANCE, PlanOptions

ARM = "arm"  # table that only an arm file has
_LEFT_OUT = ("speed", "arm.urdf", "arm.srdf")  # the plan states its speed, and compares what is in the others


@dataclass(frozen=True, eq=False)
class ArmFile:
    """An arm among bodies.

    Attributes:
        file: the arm file.
        robot: with its tool.
        limits: at speed 1.
        q_start: (n,) rad (m).
        bodies: around it.
        options: of planning.
        inputs: its keys that decide a plan.
    """

    file: Path
    robot: Robot
    limits: Limits
    q_start: Array
    bodies: tuple[Body, ...]
    options: PlanOptions
    inputs: Inputs

    @property
    def speed(self) -> float:
        """Factor on velocities."""
        return self.options.speed

    def shown_only(self) -> str:
        """Say which links of the URDF have a <visual> and no <collision>, so that nothing checks them; "" if none."""
        links = ElementTree.fromstring(self.robot.urdf).findall("link")
        bare = [
            str(link.get("name"))
            for link in links
            if link.find("visual") is not None and link.find("collision") is None
        ]
        have = "has" if len(bare) == 1 else "have"
        told = f"{', '.join(bare)} {have} a <visual> and no <collision>, and nothing checks a <visual>"
        return f"{self.file.name}: arm.urdf: {told}" if bare else ""


_NAMES = rule_of(
    "two names of links or bodies",
    lambda v: isinstance(v, list) and len(v) == 2 and all(isinstance(n, str) for n in v),
    tuple[str, str],
)
_ACCELERATION = rule_of(
    "a number above 0, or a table with one for every joint; rad/s^2, m/s^2 where a joint slides",
    lambda v: all(is_number(one) and one > 0.0 for one in (v.values() if isinstance(v, dict) else [v])),
    same,
)


class _ArmKeys(Keys):
    urdf: Path = key("urdf", path())
    srdf: Path | None = key("srdf", path(), None)
    end_frame: str = key("end_frame", line())
    tool_mm: Array = key("tool_mm", ON_FLANGE, [0, 0, 0])
    tool_rpy: Array = key("tool_rpy_deg", TURN, [0, 0, 0])
    tool_bodies: tuple[Body, ...] = key("tool_bodies", tables(lambda node: read_body(node, "tool")), [])
    locked: dict[str, Any] = key("locked", table(), {})
    neighbours: bool = key("neighbours_may_touch", flag(), False)
    disabled: tuple[tuple[str, str], ...] = key(
        "disabled_collisions",
        Rule("a list of pairs", lambda node: tuple(pair.read(_NAMES) for pair in node.items())),
        [],
    )
    acceleration: Any = key("acceleration", _ACCELERATION)


class _FileKeys(Keys, file="an arm file"):
    arm: _ArmKeys = key(ARM, Rule("a table", _ArmKeys.read))
    q_start: Array = key("q_start", numbers(None))
    speed: float = key("speed", number("", 0.01, 1.0), 0.5)
    clearance: float = key("clearance_mm", number("mm", 1e3 * LEAST_CLEARANCE, 1000.0), 10)
    bodies: tuple[Body, ...] = key("bodies", tables(lambda node: read_body(node, "wall")), [])


def read_arm_file(path: Path) -> ArmFile:
    """Read an arm file.

    Raises:
        InputError: a value is wrong; names file, key, value and rule; or the URDF is refused (`load_robot`).
    """
    root = Node.of_toml(path, "arm")
    keys = _FileKeys.read(root)
    arm, node = keys.arm, root[ARM]
    locked = {name: node["locked"].get(name, number()) for name in arm.locked}
    try:
        robot = load_robot(arm.urdf, arm.end_frame, pose_of(arm.tool_mm, arm.tool_rpy), locked, arm.srdf)
        robot = with_tool(robot, robot.T_end_tool, arm.tool_bodies) if arm.tool_bodies else robot
        if arm.disabled or arm.neighbours:
            robot = with_disabled_collisions(robot, arm.disabled, arm.neighbours)
        limits = urdf_limits(robot, arm.acceleration)
    except InputError as error:
        raise node.error(str(error)) from error
    if not any(body.link and body.joint for body in robot.bodies):
        rule = "no link that moves has a <collision>: nothing of the arm would be checked"
        raise node.error_at("urdf", rule, "a <visual> is not checked; give the links a <collision> too")
    if keys.q_start.shape != (len(robot.joint_names),):
        raise root.error_at("q_start", f"must be a number for each joint: {', '.join(robot.joint_names)}")
    beyond = beyond_limits(robot.joint_names, keys.q_start, limits)
    if beyond:
        as_degrees = np.where(_turning(robot), np.radians(keys.q_start), keys.q_start)
        help = "" if beyond_limits(robot.joint_names, as_degrees, limits) else "are these degrees?"
        raise root.error_at("q_start", f"{beyond}, in rad (m where a joint slides)", help)
    names = {body.name for body in robot.bodies}
    for one, body in zip(root["bodies"].items() if keys.bodies else (), keys.bodies, strict=True):
        if body.name in names:
            raise one.error_at("name", "is used twice, or is a body of the arm; names must differ")
        names.add(body.name)
    options = PlanOptions(speed=keys.speed, clearance=keys.clearance, line_clearance=keys.clearance)
    return ArmFile(
        path, robot, limits, keys.q_start, keys.bodies, options, config_inputs(root.value, _LEFT_OUT)
    )


def beyond_limits(names: tuple[str, ...], q: Array, limits: Limits) -> str:
    """Return in words the limit that a configuration violates, rad (m); "" if it violates none."""
    for k in np.flatnonzero((q < limits.lower) | (q > limits.upper)).tolist():
        return f"{names[k]} must be from {limits.lower[k]:g} to {limits.upper[k]:g}"
    return ""


def _turning(robot: Robot) -> list[bool]:
    """Whether each joint of an arm turns; the others slide."""
    joints = zip(robot.model.joints[1:], robot.joint_names, strict=True)
    return [joint_motion(joint, name)[0] == "revolute" for joint, name in joints]
