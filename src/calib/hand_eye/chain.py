"""The kinematic chain of an arm and a fixed camera, from Denavit-Hartenberg parameters, with all its errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from arm.robot.dh import DhTable
from arm.se3 import Array, frozen, rot_x, rot_z, transform
from calib.model.chain import Chain, Element, Evaluated, Fixed, Motion, Unknown, joined, pose_unknowns

CAMERA, TARGET, OFFSETS = 0, 6, 12
"""Index of the first unknown of the camera's extrinsics, the target's mount and the joint offsets."""
_X, _Y, _Z = np.eye(3)
_PARALLEL = 1e-3  # rad between the axes of two joints that gravity bends together


def unknown_names(joints: int) -> list[str]:
    """Names of all unknowns in order: extrinsics, mount, offsets, then d, a and alpha of every joint."""
    axes = ("x", "y", "z", "turn x", "turn y", "turn z")
    names = [f"{what} {axis}" for what in ("camera", "target") for axis in axes]
    names += [f"J{j + 1} offset" for j in range(joints)]
    return names + [f"J{j + 1} {what}" for what in ("d", "a", "alpha") for j in range(joints)]


@dataclass(frozen=True)
class SmoothError:
    """An error of a joint that varies smoothly with the pose, of unknown size: a sine or cosine of an angle.

    A gear that runs out of true errs once per turn of its joint. A link sags with the lean of what it carries, which is
    the sum of the angles of parallel joints.

    Attributes:
        joint: that errs, from 0.
        wave: "sine" or "cosine".
        angles: coefficient of every joint's reading in the angle.
    """

    joint: int
    wave: str
    angles: tuple[float, ...]

    @property
    def name(self) -> str:
        """Of the unknown; that of its gain in the chain too."""
        of = "+".join(f"J{j + 1}" for j, c in enumerate(self.angles) if c)
        return f"J{self.joint + 1} {self.wave} of {of}"

    def gain(self, readings: Array) -> Array:
        """(n,), from readings (n, joints) rad."""
        angle = readings @ np.array(self.angles)
        return np.asarray(np.sin(angle) if self.wave == "sine" else np.cos(angle))


def smooth_errors(dh: DhTable) -> list[SmoothError]:
    """Smooth errors of an arm's joints: once per turn of each, and with the lean of two parallel joints together."""
    return [SmoothError(j, wave, angles) for j, angles in _angles(dh) for wave in ("sine", "cosine")]


def _angles(dh: DhTable) -> Iterator[tuple[int, tuple[float, ...]]]:
    each = np.eye(dh.joints)
    for j in range(dh.joints):
        yield j, tuple(each[j])
    for j in range(dh.joints - 1):
        if abs(np.sin(dh.alpha[j])) < _PARALLEL:
            together = tuple(each[j] + np.sign(np.cos(dh.alpha[j])) * each[j + 1])
            yield j, together
            yield j + 1, together


def arm_chain(dh: DhTable, T_base_camera: Array, T_gripper_target: Array, smooth: bool = False) -> Chain:
    """T_camera_target with the unknowns of `unknown_names`, about a guess of extrinsics and mount (4x4 each).

    Args:
        dh: nominal parameters.
        T_base_camera, T_gripper_target: the guess.
        smooth: with the unknowns of `smooth_errors` after the others, whose names are those of their gains.
    """
    n = dh.joints
    place = Chain((Fixed(T_base_camera), *pose_unknowns(CAMERA)))
    errors = OFFSETS + n
    waves: dict[int, list[Unknown]] = {j: [] for j in range(n)}
    for k, wave in enumerate(smooth_errors(dh) if smooth else ()):
        waves[wave.joint].append(Unknown(errors + 3 * n + k, wave.name))
    links: list[Element] = []
    for j in range(n):
        links += [
            Fixed(transform(rot_z(float(dh.theta_offset[j])))),
            Motion(frozen(_Z), True, j, (Unknown(OFFSETS + j), *waves[j])),
            Fixed(transform(t=(0.0, 0.0, float(dh.d[j])))),
            Motion(frozen(_Z), False, None, (Unknown(errors + j),)),
            Fixed(transform(t=(float(dh.a[j]), 0.0, 0.0))),
            Motion(frozen(_X), False, None, (Unknown(errors + n + j),)),
            Fixed(transform(rot_x(float(dh.alpha[j])))),
            Motion(frozen(_X), True, None, (Unknown(errors + 2 * n + j),)),
        ]
    mount: list[Element] = [Fixed(T_gripper_target), *pose_unknowns(TARGET)]
    return joined([*place.inverse().elements, *links, *mount])


def free_pose(guess: Array, first: int, unknowns: Array) -> Evaluated:
    """Evaluate a pose about a guess (4x4), whose unknowns begin at `first`: `CAMERA` or `TARGET`."""
    return Chain((Fixed(guess), *pose_unknowns(first))).evaluate(np.zeros((1, 0)), unknowns)
