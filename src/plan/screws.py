"""An arm as a product of exponentials: tool poses and Jacobians of many configurations at once, in numpy.

T_base_tool(q) = exp(S1 q1) .. exp(Sn qn) T_base_tool(0), every joint a rotation about a line fixed in the base
(R. W. Brockett 1984; K. Lynch, F. Park, "Modern Robotics", 2017, section 4.1.1). The lines are taken from the
Robot's own Jacobian at q = 0, so a calibrated model is followed as it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.poses import adjoint
from arm.robot import Robot
from arm.se3 import Array, frozen, skew


@dataclass(frozen=True, eq=False)
class Axis:
    """A joint's line at q = 0, in the base frame.

    Attributes:
        direction: unit vector (3,).
        point: the point of the line nearest to the base's origin (3,), m.
        along, across, turn: the 3x3 parts of Rodrigues' formula, R(angle) = along + cos across + sin turn.
    """

    direction: Array
    point: Array
    along: Array
    across: Array
    turn: Array

    def rotations(self, angles: Array) -> Array:
        """Rotation matrices (..., 3, 3) for angles (...) in rad."""
        angles = angles[..., None, None]
        return self.along + np.cos(angles) * self.across + np.sin(angles) * self.turn


@dataclass(frozen=True, eq=False)
class ScrewArm:
    """Axes of all joints, in order, and the tool's pose (4x4) at q = 0."""

    axes: tuple[Axis, ...]
    T_base_tool_0: Array

    def tool_poses(self, q: npt.ArrayLike) -> Array:
        """Tool poses (..., 4, 4) of configurations (..., n) in rad."""
        q = np.asarray(q, dtype=float)
        T = np.empty((*q.shape[:-1], 4, 4))
        T[...] = self.T_base_tool_0
        for axis, angle in zip(reversed(self.axes), np.moveaxis(q, -1, 0)[::-1], strict=True):
            T[..., :3, 3] -= axis.point
            T[..., :3, :] = axis.rotations(angle) @ T[..., :3, :]
            T[..., :3, 3] += axis.point
        return T

    def jacobians(self, q: npt.ArrayLike) -> Array:
        """Jacobians (..., 6, n) of the tool's origin (rows 0-2, m) and of its rotation (rows 3-5, rad), base axes."""
        q = np.asarray(q, dtype=float)
        tip = self.tool_poses(q)[..., :3, 3]
        J = np.empty((*q.shape[:-1], 6, len(self.axes)))
        R = np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3))
        origin = np.zeros((*q.shape[:-1], 3))  # image of the base's origin under the joints passed so far
        for i, axis in enumerate(self.axes):
            direction = R @ axis.direction
            J[..., :3, i] = np.cross(direction, tip - (origin + R @ axis.point))
            J[..., 3:, i] = direction
            turn = axis.rotations(q[..., i])
            origin = origin + (R @ (axis.point - turn @ axis.point)[..., None])[..., 0]
            R = R @ turn
        return J


@lru_cache(maxsize=32)
def screw_arm(robot: Robot) -> ScrewArm:
    """The robot as a product of exponentials (kept: building it costs about 0.1 ms).

    Raises:
        InputError: a joint is not a rotation.
    """
    zero = np.zeros(robot.model.nq)
    T_base_tool = robot.T_base_tool(zero)
    twists = adjoint(T_base_tool) @ robot.jacobian(zero).reshape(6, -1)
    axes = []
    for name, twist in zip(robot.joint_names, twists.T, strict=True):
        velocity, direction = twist[:3], twist[3:]
        if abs(np.linalg.norm(direction) - 1.0) > 1e-9 or abs(velocity @ direction) > 1e-9:
            raise InputError(
                f"joint {name} is not a rotation about an axis; sliding joints are not supported", joint=name
            )
        along = np.outer(direction, direction)
        axes.append(
            Axis(
                frozen(direction),
                frozen(np.cross(direction, velocity)),
                frozen(along),
                frozen(np.eye(3) - along),
                frozen(skew(direction)),
            )
        )
    return ScrewArm(tuple(axes), T_base_tool)
