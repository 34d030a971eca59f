"""An arm as a product of exponentials: tool poses and Jacobians of many configurations at once, in numpy.

T_base_tool(q) = exp(S1 q1) .. exp(Sn qn) T_base_tool(0); each joint rotates about a line or moves along a direction
fixed in the base (R. W. Brockett 1984; K. Lynch, F. Park, "Modern Robotics", 2017, section 4.1.1). The lines come from
the Robot's Jacobian at q = 0, so calibrated models are included.

Internally vectors are columns (3, ..., N), so that one product with a 3x3 matrix handles all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.former import former_names
from arm.numerics.products import mul, norm
from arm.poses import adjoint
from arm.robot.model import Robot
from arm.se3 import Array, frozen, skew


@dataclass(frozen=True, eq=False)
class Axis:
    """A joint axis at q = 0, in the base frame.

    Attributes:
        direction: unit vector (3,).
        point: the point of the axis nearest to the base's origin (3,), m; zero for a prismatic joint.
        along, across, turn: the 3x3 parts of Rodrigues' formula, R(angle) = along + cos across + sin turn; the identity
            and zeros for a prismatic joint.
        slides: whether the joint is prismatic; q is then in m.
    """

    direction: Array
    point: Array
    along: Array
    across: Array
    turn: Array
    slides: bool = False

    @cached_property
    def parts(self) -> Array:
        """`along`, `across` and `turn` stacked, (9, 3)."""
        return frozen(np.concatenate([self.along, self.across, self.turn]))

    def turned(self, columns: Array, cosine: Array, sine: Array) -> Array:
        """Rotate columns (3, ..., N) by N angles; a negated `sine` rotates them back."""
        parts = (mul(self.parts, columns.reshape(3, -1))).reshape(3, *columns.shape)
        return np.asarray(parts[0] + cosine * parts[1] + sine * parts[2])


def axis_of(twist: Array) -> Axis:
    """Return the axis of a joint by its twist (6,) at q = 0 in the base frame, translation first."""
    velocity, direction = twist[:3], twist[3:]
    if norm(direction) < 1e-9:
        none = frozen(np.zeros((3, 3)))
        return Axis(frozen(velocity), frozen(np.zeros(3)), frozen(np.eye(3)), none, none, slides=True)
    along = np.outer(direction, direction)
    point = np.cross(direction, velocity)
    return Axis(
        frozen(direction), frozen(point), frozen(along), frozen(np.eye(3) - along), frozen(skew(direction))
    )


@dataclass(frozen=True, eq=False)
class ProductOfExponentials:
    """Axes of all joints, in order, and the tool's pose (4x4) at q = 0."""

    axes: tuple[Axis, ...]
    T_base_tool_0: Array

    def tool_columns(self, q: Array) -> Array:
        """Return the upper three rows of the tool pose at configurations (N, n), as (3, 4, N)."""
        columns = np.empty((3, 4, len(q)))
        columns[...] = self.T_base_tool_0[:3, :, None]
        cosine, sine = np.cos(q.T), np.sin(q.T)
        for k in reversed(range(len(self.axes))):
            axis = self.axes[k]
            if axis.slides:
                columns[:, 3] += axis.direction[:, None] * q[:, k]
                continue
            columns[:, 3] -= axis.point[:, None]
            columns = axis.turned(columns, cosine[k], sine[k])
            columns[:, 3] += axis.point[:, None]
        return columns

    def tool_poses(self, q: npt.ArrayLike) -> Array:
        """Return the tool poses (..., 4, 4) at configurations (..., n) in rad (m for a prismatic joint)."""
        q = np.asarray(q, dtype=float)
        T = np.zeros((*q.shape[:-1], 4, 4))
        columns = self.tool_columns(q.reshape(-1, len(self.axes)))
        T[..., :3, :] = np.moveaxis(columns, -1, 0).reshape(*q.shape[:-1], 3, 4)
        T[..., 3, 3] = 1.0
        return T

    def jacobians(self, q: npt.ArrayLike, tip: Array | None = None) -> Array:
        """Return the Jacobians (..., 6, n) of tool position (rows 0-2, m) and rotation (rows 3-5, rad), in base axes.

        Args:
            q: (..., n).
            tip: position of the tool (..., 3) in the base, if already known.
        """
        q = np.asarray(q, dtype=float)
        flat = q.reshape(-1, len(self.axes))
        at = (self.tool_columns(flat)[:, 3] if tip is None else tip.reshape(-1, 3).T)[:, None]
        cosine, sine = np.cos(flat.T), np.sin(flat.T)
        # direction and point of each axis, moved by the joints before it
        count = len(self.axes)
        lines = np.empty((3, count, 2, len(flat)))
        for k in reversed(range(count)):
            axis, beyond = self.axes[k], lines[:, k + 1 :]
            lines[:, k, 0], lines[:, k, 1] = axis.direction[:, None], axis.point[:, None]
            if axis.slides:
                beyond[:, :, 1] += (axis.direction[:, None] * flat[:, k])[:, None]
            elif k + 1 < count:
                beyond[:, :, 1] -= axis.point[:, None, None]
                beyond[...] = axis.turned(beyond, cosine[k], sine[k])
                beyond[:, :, 1] += axis.point[:, None, None]
        d, r = lines[:, :, 0], at - lines[:, :, 1]
        J = np.empty((6, count, len(flat)))
        J[0] = d[1] * r[2] - d[2] * r[1]
        J[1] = d[2] * r[0] - d[0] * r[2]
        J[2] = d[0] * r[1] - d[1] * r[0]
        J[3:] = d
        for k, axis in enumerate(self.axes):
            if axis.slides:
                J[:3, k], J[3:, k] = d[:, k], 0.0
        return np.ascontiguousarray(np.moveaxis(J, -1, 0)).reshape(*q.shape[:-1], 6, count)


@lru_cache(maxsize=32)
def product_of_exponentials(robot: Robot) -> ProductOfExponentials:
    """Return the robot as a product of exponentials; cached, because it takes about 0.1 ms.

    Raises:
        InputError: a joint is neither revolute nor prismatic.
    """
    zero = np.zeros(robot.model.nq)
    T_base_tool = robot.T_base_tool(zero)
    twists = mul(adjoint(T_base_tool), robot.jacobian(zero).reshape(6, -1)).T
    axes = tuple(axis_of(twist) for twist in twists)
    for name, twist, axis in zip(robot.joint_names, twists, axes, strict=True):
        pitch = 0.0 if axis.slides else abs(mul(twist[:3], axis.direction))
        if abs(norm(axis.direction) - 1.0) > 1e-9 or pitch > 1e-9:
            raise InputError(f"joint {name}: must be revolute or prismatic", joint=name)
    return ProductOfExponentials(axes, T_base_tool)


former_names(__name__, __name__, screw_arm="product_of_exponentials", ScrewArm="ProductOfExponentials")
