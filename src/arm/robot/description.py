"""An arm as JSON types, complete, so that a plan file alone gives the arm again: no URDF, SRDF or mesh is needed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from arm.errors import A465Error, InputError
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import integer, line, number, numbers, rigid, rule_of, same, table, tables, text
from arm.numerics.products import norm
from arm.robot.model import LinkBody, Robot
from arm.robot.shapes import Shape, shape_from_json, shape_to_json
from arm.se3 import Array, frozen

KINDS = {"revolute": pin.JointModelRevoluteUnaligned, "prismatic": pin.JointModelPrismaticUnaligned}
_AXES = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
_UNIT = 1e-6  # tolerance of the length of an axis


def joint_motion(joint: pin.JointModel, name: str) -> tuple[str, Array]:
    """Return the kind of a joint, of `KINDS`, and its axis (3,) in its own frame.

    Raises:
        InputError: it is of another kind.
    """
    kind = joint.shortname()
    for ours, model in KINDS.items():
        if kind == model().shortname():
            return ours, frozen(joint.extract().axis)
    if kind[:-1] in {"JointModelR", "JointModelP"} and kind[-1] in _AXES:
        return "revolute" if kind[-2] == "R" else "prismatic", frozen(_AXES[kind[-1]])
    why = f"joint {name}: is a {kind}; only revolute and prismatic joints are supported"
    raise InputError(why, joint=name, kind=kind)


def robot_to_json(robot: Robot) -> dict[str, Any]:
    """Return an arm as JSON types. Poses are rounded to 1e-12: their last bit differs between processors."""
    joints = []
    for index, name in enumerate(robot.joint_names, start=1):
        kind, axis = joint_motion(robot.model.joints[index], name)
        placement = robot.model.jointPlacements[index].homogeneous
        joints.append({"name": name, "kind": kind, "axis": axis.tolist(), "T_parent_joint": _rows(placement)})
    return {
        "digest": robot.digest,
        "joints": joints,
        "end_frame": robot.end_frame,
        "T_joint_end": _rows(robot.T_joint_end),
        "T_end_tool": _rows(robot.T_end_tool),
        "bodies": [
            {**vars(body), "shape": shape_to_json(body.shape), "T_joint_body": _rows(body.T_joint_body)}
            for body in robot.bodies
        ],
        "disabled_collisions": sorted(sorted(pair) for pair in robot.disabled_collisions),
        "locked": dict(robot.locked),
        "urdf": robot.urdf if robot.ideal is None else "",  # it has not the corrections of a calibrated arm
    }


def _rows(T: Array) -> list[list[float]]:
    return (np.round(T, 12) + 0.0).tolist()  # type: ignore[no-any-return]


def _shape(node: Node) -> Shape:
    try:
        return shape_from_json(node.value)
    except (A465Error, TypeError, ValueError) as error:
        raise node.error(f"is not a shape: {error}") from error


def _axis(node: Node) -> Array:
    axis = node.read(numbers(3))
    if not abs(norm(axis) - 1.0) < _UNIT:
        raise node.error("must be a unit vector")
    return axis


class _JointKeys(Keys):
    name: str = key("name", line())
    kind: str = key("kind", text(*KINDS))
    axis: Array = key("axis", Rule("a unit vector", _axis))
    T_parent_joint: Array = key("T_parent_joint", rigid())


class _BodyKeys(Keys):
    name: str = key("name", line())
    link: str = key("link", line())
    joint: int = key("joint", integer(0, 1000))
    shape: Shape = key("shape", Rule("a shape", _shape))
    T_joint_body: Array = key("T_joint_body", rigid())
    padding: float = key("padding", number("", 0.0, 0.5))


_NAMES = rule_of(
    "two names",
    lambda v: isinstance(v, list) and len(v) == 2 and all(isinstance(n, str) for n in v),
    frozenset[str],
)


class _RobotKeys(Keys):
    digest: str = key("digest", line())
    joints: tuple[_JointKeys, ...] = key("joints", tables(_JointKeys.read))
    end_frame: str = key("end_frame", line())
    T_joint_end: Array = key("T_joint_end", rigid())
    T_end_tool: Array = key("T_end_tool", rigid())
    bodies: tuple[_BodyKeys, ...] = key("bodies", tables(_BodyKeys.read))
    disabled: frozenset[frozenset[str]] = key(
        "disabled_collisions",
        Rule("a list of pairs", lambda node: frozenset(pair.read(_NAMES) for pair in node.items())),
    )
    locked: dict[str, Any] = key("locked", table())
    urdf: str = key("urdf", rule_of("text", lambda v: isinstance(v, str), same))


def robot_from_json(node: Node) -> Robot:
    """Invert `robot_to_json`. The arm has no joint limits of its own.

    Raises:
        FileInputError: a value is missing or breaks its rule.
    """
    keys = _RobotKeys.read(node)
    if not keys.joints:
        raise node["joints"].error("must be at least one joint")
    model = pin.Model()
    for joint in keys.joints:
        motion = KINDS[joint.kind](joint.axis)
        model.addJoint(model.njoints - 1, motion, pin.SE3(joint.T_parent_joint), joint.name)
    last = model.njoints - 1
    model.addFrame(pin.Frame(keys.end_frame, last, pin.SE3(keys.T_joint_end), pin.FrameType.OP_FRAME))
    for place, body in zip(node["bodies"].items(), keys.bodies, strict=True):
        if body.joint > last:
            raise place["joint"].error(f"must be at most {last}, the number of joints")
    return Robot(
        model=model,
        end_frame=keys.end_frame,
        T_end_tool=keys.T_end_tool,
        bodies=tuple(LinkBody(**vars(body)) for body in keys.bodies),
        disabled_collisions=keys.disabled,
        digest=keys.digest,
        urdf=keys.urdf,
        locked={name: node["locked"].get(name, number()) for name in keys.locked},
    )
