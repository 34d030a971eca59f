"""Errors of Denavit-Hartenberg parameters, applied to the model of an arm."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from arm.errors import InputError
from arm.io.storage import sha256
from arm.numerics.products import mul, norm
from arm.robot.dh import DhTable
from arm.robot.model import Robot
from arm.se3 import Array, frozen, inverse, rot_x, rot_z, transform

_SAME = 1e-6  # m, and of unit vectors


@dataclass(frozen=True, eq=False)
class LinkErrors:
    """Corrections to the Denavit-Hartenberg parameters of an arm, (joints,) each: d, a in m; alpha in rad.

    Those of the last link are not applied, because a calibration cannot separate them from the mounting of the tool.
    """

    d: Array
    a: Array
    alpha: Array

    @classmethod
    def none(cls, joints: int = 6) -> LinkErrors:
        """Return zero corrections."""
        return cls(*(frozen(np.zeros(joints)) for _ in range(3)))

    @property
    def any(self) -> bool:
        """Whether any correction that is applied is not zero."""
        return any(bool(np.any(values[:-1])) for values in (self.d, self.a, self.alpha))

    def to_json(self) -> list[list[float]]:
        """Return d, a, alpha as lists without negative zeros."""
        return [(values + 0.0).tolist() for values in (self.d, self.a, self.alpha)]


def with_link_errors(robot: Robot, dh: DhTable, errors: LinkErrors) -> Robot:
    """Return the arm with corrected poses between its joints; bodies move with their joints.

    Args:
        robot: an arm of revolute joints whose flange is the last frame of `dh`.
        dh: its nominal parameters.
        errors: corrections to these.

    Raises:
        InputError: the arm is not the one of `dh`.
    """
    if not errors.any:
        return robot
    n = dh.joints
    counts = [len(v) for v in (errors.d, errors.a, errors.alpha)]
    if {len(robot.joint_names), *counts} != {n}:
        why = f"link errors d, a, alpha have {counts} joints, the arm has {len(robot.joint_names)}, its DH table {n}"
        raise InputError(why)
    poses = robot.joint_poses(np.zeros(n))
    model = robot.model.copy()
    T_base_link = np.eye(4)
    for j in range(n):
        turn = transform(rot_z(float(dh.theta_offset[j])))
        nominal = _link(dh.d[j], dh.a[j], dh.alpha[j])
        z, apart = T_base_link[:3, 2], poses[j + 1][:3, 3] - T_base_link[:3, 3]
        if norm(z - _axis(robot, poses, j)) > _SAME or norm(np.cross(z, apart)) > _SAME:
            raise InputError(f"joint {robot.joint_names[j]}: its axis is not that of the DH table", joint=j)
        T_base_link = mul(mul(T_base_link, turn), nominal)
        if j + 1 == n:
            break
        true = _link(dh.d[j] + errors.d[j], dh.a[j] + errors.a[j], dh.alpha[j] + errors.alpha[j])
        T_joint_link = mul(inverse(poses[j + 1]), T_base_link)
        moved = mul(mul(mul(T_joint_link, inverse(nominal)), true), inverse(T_joint_link))
        model.jointPlacements[j + 2] = pin.SE3(mul(moved, model.jointPlacements[j + 2].homogeneous))
    digest = sha256({"robot": robot.digest, "link_errors": errors.to_json()})
    return replace(robot, model=model, digest=digest, ideal=robot)


def _link(d: float, a: float, alpha: float) -> Array:
    return transform(rot_x(float(alpha)), (float(a), 0.0, float(d)))


def _axis(robot: Robot, poses: Array, j: int) -> Array:
    kind = robot.model.joints[j + 1].shortname()
    column = "XYZ".find(kind[-1])
    if not kind.startswith("JointModelR") or column < 0:
        raise InputError(f"joint {robot.joint_names[j]}: is a {kind}; link errors need revolute joints")
    return np.asarray(poses[j + 1][:3, column])
