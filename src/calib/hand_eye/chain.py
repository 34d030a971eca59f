"""The kinematic chain of an arm and a fixed camera, from Denavit-Hartenberg parameters, with all its errors."""

from __future__ import annotations

import numpy as np

from arm.robot.dh import DhTable
from arm.se3 import Array, frozen, rot_x, rot_z, transform
from calib.model.chain import Chain, Element, Fixed, Motion, Unknown, joined, pose_unknowns

CAMERA, TARGET, OFFSETS = 0, 6, 12
"""Index of the first unknown of the camera's extrinsics, the target's mount and the joint offsets."""
_X, _Y, _Z = np.eye(3)


def unknown_names(joints: int) -> list[str]:
    """Names of all unknowns in order: extrinsics, mount, offsets, then d, a and alpha of every joint."""
    axes = ("x", "y", "z", "turn x", "turn y", "turn z")
    names = [f"{what} {axis}" for what in ("camera", "target") for axis in axes]
    names += [f"J{j + 1} offset" for j in range(joints)]
    return names + [f"J{j + 1} {what}" for what in ("d", "a", "alpha") for j in range(joints)]


def arm_chain(dh: DhTable, T_base_camera: Array, T_gripper_target: Array) -> Chain:
    """T_camera_target with the unknowns of `unknown_names`, about a guess of extrinsics and mount (4x4 each)."""
    n = dh.joints
    place = Chain((Fixed(T_base_camera), *pose_unknowns(CAMERA)))
    errors = OFFSETS + n
    links: list[Element] = []
    for j in range(n):
        links += [
            Fixed(transform(rot_z(float(dh.theta_offset[j])))),
            Motion(frozen(_Z), True, j, (Unknown(OFFSETS + j),)),
            Fixed(transform(t=(0.0, 0.0, float(dh.d[j])))),
            Motion(frozen(_Z), False, None, (Unknown(errors + j),)),
            Fixed(transform(t=(float(dh.a[j]), 0.0, 0.0))),
            Motion(frozen(_X), False, None, (Unknown(errors + n + j),)),
            Fixed(transform(rot_x(float(dh.alpha[j])))),
            Motion(frozen(_X), True, None, (Unknown(errors + 2 * n + j),)),
        ]
    mount: list[Element] = [Fixed(T_gripper_target), *pose_unknowns(TARGET)]
    return joined([*place.inverse().elements, *links, *mount])


def place_and_mount(T_base_camera: Array, T_gripper_target: Array, unknowns: Array) -> tuple[Array, Array]:
    """Apply the unknowns to T_base_camera and T_gripper_target, 4x4 each."""

    def pose(first: int, guess: Array) -> Array:
        return frozen(Chain((Fixed(guess), *pose_unknowns(first))).evaluate(np.zeros((1, 0)), unknowns).T[0])

    return pose(CAMERA, T_base_camera), pose(TARGET, T_gripper_target)
