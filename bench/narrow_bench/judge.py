"""A judge that shares nothing with the planner but the bodies: coal, pair by pair, at steps of 0.002 rad.

Poses come from Pinocchio's forward kinematics. Bounding spheres and boxes, computed here, leave out pairs that are far
apart. There are no broadphase, pairs, margins or proofs of the planner.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import ceil
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from peers.coal_shapes import coal_shape, coal_transform

from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Capsule, Cylinder, Shape, Sphere
from arm.se3 import Array

STEP = 0.002  # rad, largest step of a joint
FAR = 0.01  # m; larger distances are reported as this


class Judge:
    """Least distance along paths of one arm among still bodies."""

    def __init__(self, robot: Robot, bodies: Sequence[Body]) -> None:
        self.robot, self.data = robot, robot.model.createData()
        self.moving = [b for b in robot.bodies if b.joint]
        still = [
            *(Body(b.name, b.shape, b.T_joint_body, "base") for b in robot.bodies if not b.joint),
            *bodies,
        ]
        self.still = [(b.name, coal_shape(b.shape), coal_transform(b.T_base_body)) for b in still]
        self.shapes = [coal_shape(b.shape) for b in self.moving]
        self.joint = np.array([b.joint for b in self.moving])
        self.local = np.stack([b.T_joint_body for b in self.moving])
        self.radius = np.array([_radius(b.shape) for b in self.moving])
        self.T_still = np.stack([b.T_base_body for b in still])
        self.half = np.stack([_half(b.shape) for b in still])
        apart = robot.disabled_collisions
        names = [b.name for b in self.moving]
        self.against = np.array([[frozenset((n, s.name)) not in apart for s in still] for n in names])
        self.own = np.array(
            [[self.joint[i] < self.joint[j] and frozenset((a, b)) not in apart for j, b in enumerate(names)]
             for i, a in enumerate(names)]
        )  # fmt: skip
        self.request = coal.DistanceRequest()

    def least_distance(self, path: Array) -> float:
        """Return the least distance along a path (m, n), m, at most `FAR`; minus the depth if bodies overlap."""
        found = FAR
        for a, b in pairwise(path):
            count = max(ceil(float(np.abs(b - a).max()) / STEP), 1)
            for i in range(count + 1):
                found = min(found, self._least(a + (i / count) * (b - a)))
        return found

    def _least(self, q: Array) -> float:
        pin.forwardKinematics(self.robot.model, self.data, q)
        T = np.stack([M.homogeneous for M in self.data.oMi])[self.joint] @ self.local
        centre = T[:, :3, 3]
        offset = np.einsum("sji,msj->msi", self.T_still[:, :3, :3], centre[:, None] - self.T_still[:, :3, 3])
        gap = np.linalg.norm(np.maximum(np.abs(offset) - self.half, 0.0), axis=-1) - self.radius[:, None]
        between = np.linalg.norm(centre[:, None] - centre, axis=-1) - self.radius[:, None] - self.radius
        placed: dict[int, Any] = {}
        least = FAR
        for i, s in np.argwhere(self.against & (gap < FAR)).tolist():
            _, shape, at = self.still[s]
            least = min(least, self._distance(self.shapes[i], _placed(placed, T, i), shape, at))
        for i, j in np.argwhere(self.own & (between < FAR)).tolist():
            first, second = _placed(placed, T, i), _placed(placed, T, j)
            least = min(least, self._distance(self.shapes[i], first, self.shapes[j], second))
        return least

    def _distance(self, first: Any, T_first: Any, second: Any, T_second: Any) -> float:
        return float(coal.distance(first, T_first, second, T_second, self.request, coal.DistanceResult()))


def _placed(placed: dict[int, Any], T: Array, i: int) -> Any:
    if i not in placed:
        placed[i] = coal_transform(T[i])
    return placed[i]


def _half(shape: Shape) -> Array:
    """Half sizes of a box around a shape."""
    match shape:
        case Box(size):
            return np.array(size) / 2.0
        case Cylinder(radius, length):
            return np.array([radius, radius, length / 2.0])
        case Capsule(radius, length):
            return np.array([radius, radius, length / 2.0 + radius])
        case Sphere(radius):
            return np.full(3, radius)
        case other:
            raise ValueError(f"the judge has no shape for {type(other).__name__}")


def _radius(shape: Shape) -> float:
    """Radius of a ball around a shape."""
    return shape.radius if isinstance(shape, Sphere) else float(np.linalg.norm(_half(shape)))
