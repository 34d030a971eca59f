"""The arm file (TOML): any arm from its URDF, its tool, where it starts, and the bodies around it; for lists of poses.

docs/adding.md has the keys. Positions of joints are in rad, or in m where a joint slides, as in URDF and SRDF.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from arm.controller.unit import Limits
from arm.errors import FileInputError, InputError
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
        tool_frame_given: whether the file places the tool frame, or has no bodies of a tool.
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

    tool_frame_given: bool = True

    def doubts(self) -> Iterator[str]:
        """Say what of the arm nothing checks, and which values may be in another unit, each with its file and key."""
        if unchecked := self._shown_only():
            yield f"{self.file.name}: arm.urdf: {unchecked}"
        for name, turns, v, a in zip(
            self.robot.joint_names,
            _turning(self.robot),
            self.limits.velocity,
            self.limits.acceleration,
            strict=True,
        ):
            for told in _joint_doubts(turns, float(v), float(a)):
                yield f"{self.file.name}: joint {name}: {told}"
        links = [body for body in self.robot.bodies if body.link]
        pairs = [(a, b) for a, b in combinations(links, 2) if abs(a.joint - b.joint) > 1]
        if pairs and all(frozenset((a.name, b.name)) in self.robot.disabled_collisions for a, b in pairs):
            yield (
                f"{self.file.name}: the SRDF or arm.disabled_collisions disable all pairs of links: the arm is not "
                "checked against itself"
            )
        if not self.tool_frame_given:
            yield (
                f"{self.file.name}: arm.tool_mm is missing although there are arm.tool_bodies: the tool frame is then "
                f"that of {self.robot.end_frame}, not the tool's tip"
            )

    def _shown_only(self) -> str:
        """Say which links of the URDF have a <visual> and no <collision>, so that nothing checks them; "" if none."""
        links = ElementTree.fromstring(self.robot.urdf).findall("link")
        bare = [
            str(link.get("name"))
            for link in links
            if link.find("visual") is not None and link.find("collision") is None
        ]
        have = "has" if len(bare) == 1 else "have"
        told = f"{', '.join(bare)} {have} a <visual> and no <collision>, and nothing checks a <visual>"
        return told if bare else ""


_FAST = {True: 30.0, False: 20.0}  # rad/s, m/s: beyond those of arms, by whether the joint turns
_HARD = {True: 300.0, False: 300.0}  # rad/s^2, m/s^2
_LONG = 30.0  # s, to reach the velocity


def _joint_doubts(turns: bool, v: float, a: float) -> Iterator[str]:
    """Say which limit of a joint, SI units, is rather in deg or mm."""
    unit, other, ratio = ("rad", "deg", np.pi / 180.0) if turns else ("m", "mm", 1e-3)
    if v > _FAST[turns]:
        yield (
            f"its velocity in the URDF is {v:g} {unit}/s: is it in {other}/s? Then it must be {ratio * v:.4g} {unit}/s"
        )
    if a > _HARD[turns]:
        yield (
            f"arm.acceleration is {a:g} {unit}/s^2: is it in {other}/s^2? Then it must be {ratio * a:.4g} {unit}/s^2"
        )
    elif v / a > _LONG and v <= _FAST[turns]:
        yield (
            f"at arm.acceleration = {a:g} {unit}/s^2 it needs {v / a:.0f} s to reach {v:g} {unit}/s: is it too small?"
        )


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
    q_start: Array = key("q_start", numbers(None, "rad, m where a joint slides"))
    speed: float = key("speed", number("", 0.01, 1.0), 0.5)
    clearance: float = key("clearance_mm", number("mm", 1e3 * LEAST_CLEARANCE, 100.0), 10)
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
        raise FileInputError(path, ARM, None, str(error)) from error
    if not any(body.link and body.joint for body in robot.bodies):
        rule = "no link that moves has a <collision>: nothing of the arm would be checked"
        raise node.error_at("urdf", rule, "a <visual> is not checked; give the links a <collision> too")
    if keys.q_start.shape != (len(robot.joint_names),):
        given, count = np.size(keys.q_start), len(robot.joint_names)
        help = (
            f"{', '.join(arm.locked)}: locked, and has none" if arm.locked else f"it has {given}, not {count}"
        )
        raise root.error_at(
            "q_start", f"must be a number for each joint: {', '.join(robot.joint_names)}", help
        )
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
        path,
        robot,
        limits,
        keys.q_start,
        keys.bodies,
        options,
        config_inputs(root.value, _LEFT_OUT),
        not arm.tool_bodies or "tool_mm" in node,
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
