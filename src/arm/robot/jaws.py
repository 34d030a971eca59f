"""Jaws with unknown opening: fingers that cover all their possible positions."""

from __future__ import annotations

from dataclasses import replace

from arm.errors import InputError
from arm.io.storage import sha256
from arm.numerics.products import mul
from arm.robot.model import LinkBody, Robot
from arm.robot.shapes import Box
from arm.se3 import Array, frozen, inverse

FINGERS = ("finger_l", "finger_r")


def with_any_jaws(robot: Robot) -> Robot:
    """Extend the fingers inwards until they meet; a clearance then holds for every narrower opening too.

    Args:
        robot: an arm with boxes as fingers that close along the y axis of its end frame, like that of
            `arm.robot.model.load_a465`.

    Raises:
        InputError: the arm has no such fingers.
    """
    T_joint_end = robot.T_joint_end
    found = {body.name for body in robot.bodies if isinstance(body.shape, Box)}
    missing = [name for name in FINGERS if name not in found]
    if missing:
        raise InputError(f"the arm has no finger {missing[0]!r} that is a box", name=missing[0])
    bodies = tuple(_extended(b, T_joint_end) if b.name in FINGERS else b for b in robot.bodies)
    return replace(robot, bodies=bodies, digest=sha256({"robot": robot.digest, "jaws": "any"}))


def after_closing(robot: Robot) -> Robot:
    """Return the arm once its jaws have closed on nothing that is known, so that their opening is not.

    Jaws that are not modelled as `with_any_jaws` needs them stay where they are.
    """
    known = {body.name for body in robot.bodies if isinstance(body.shape, Box)}
    return with_any_jaws(robot) if known.issuperset(FINGERS) else robot


def _extended(finger: LinkBody, T_joint_end: Array) -> LinkBody:
    """Extend a finger from its outer face to the middle."""
    T_end_finger = mul(inverse(T_joint_end), finger.T_joint_body)
    x, y, z = finger.shape.size  # type: ignore[union-attr]
    outer = abs(float(T_end_finger[1, 3])) + y / 2.0
    T_end_finger[1, 3] = outer / 2.0 if T_end_finger[1, 3] > 0.0 else -outer / 2.0
    return replace(finger, shape=Box((x, outer, z)), T_joint_body=frozen(mul(T_joint_end, T_end_finger)))
