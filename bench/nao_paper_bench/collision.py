"""Collision and occlusion model of a NAO: capsules, boxes and spheres of our own making.

No shape is Aldebaran's. They are rough and slightly too large, derived from the lengths in ``urdf/nao`` and the outline
of the robot. The robot lies on its back: the floor is behind its torso, and its arms lie along it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import coal
import numpy as np
import pinocchio as pin

from arm.se3 import Array, rotation, transform
from calib.nao.chain import HEAD, LEG, SIDES, nao_model

BOARD_MIDDLE_X, BOARD_SIZE = 0.17, (0.125, 0.175)
"""Checkerboard in the sole frame, m: centre ahead of the ankle; size, 5 tiles along x and 7 along y."""
_ARM_Y, _FLOOR_X = 0.135, -0.085
_FROM_EYE = 0.05  # share of the line of sight inside the eye's own housing


@dataclass(frozen=True, eq=False)
class _Shape:
    name: str
    joint: str  # "universe" if fixed to the torso
    T: Array
    solid: coal.CollisionGeometry


def _capsule(name: str, joint: str, a: Array, b: Array, radius: float) -> _Shape:
    along = b - a
    length = float(np.linalg.norm(along))
    z = np.array([0.0, 0.0, 1.0])
    axis = np.cross(z, along / length)
    sine = float(np.linalg.norm(axis))
    angle = float(np.arctan2(sine, along[2] / length))
    R = rotation(axis / sine * angle) if sine > 1e-9 else rotation([angle, 0.0, 0.0])
    return _Shape(name, joint, transform(R, (a + b) / 2.0), coal.Capsule(radius, length))


def _box(
    name: str, joint: str, middle: tuple[float, float, float], size: tuple[float, float, float]
) -> _Shape:
    return _Shape(name, joint, transform(t=middle), coal.Box(*size))


def _shapes() -> list[_Shape]:
    shapes = [
        _box("torso", "universe", (0.0, 0.0, 0.055), (0.13, 0.16, 0.14)),
        _box("floor", "universe", (_FLOOR_X - 0.05, 0.0, -0.1), (0.1, 2.0, 2.0)),
        _capsule("neck and head", "HeadYaw", np.array([0.0, 0.0, 0.03]), np.array([0.0, 0.0, 0.07]), 0.05),
    ]
    for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
        shapes += [
            _capsule(
                f"{side} arm",
                "universe",
                np.array([0.0, sign * _ARM_Y, 0.10]),
                np.array([-0.02, sign * _ARM_Y, -0.10]),
                0.035,
            ),
            _capsule(
                f"{side} thigh",
                f"{side}HipPitch",
                np.array([0.0, 0.0, -0.02]),
                np.array([0.0, 0.0, -0.085]),
                0.042,
            ),
            _capsule(
                f"{side} tibia",
                f"{side}KneePitch",
                np.array([0.0, 0.0, -0.01]),
                np.array([0.0, 0.0, -0.09]),
                0.04,
            ),
            _box(f"{side} foot", f"{side}AnkleRoll", (0.02, 0.0, -0.025), (0.16, 0.09, 0.035)),
            _box(
                f"{side} panel",
                f"{side}AnkleRoll",
                (0.17, 0.0, -0.0475),  # its upper side is the sole's plane
                (BOARD_SIZE[0] + 0.01, BOARD_SIZE[1] + 0.01, 0.003),
            ),
        ]
    return shapes


_JOINED = {
    frozenset(pair)
    for side in SIDES
    for pair in (
        (f"{side} thigh", f"{side} tibia"),
        (f"{side} tibia", f"{side} foot"),
        (f"{side} foot", f"{side} panel"),
    )
}
_OF_LEGS = ("thigh", "tibia", "foot", "panel")
_FIXED = ("torso", "floor", "L arm", "R arm", "neck and head")


class NaoBodies:
    """Collisions and occlusions for a whole posture: head and both legs."""

    def __init__(self) -> None:
        self._model = nao_model()
        self._data = self._model.createData()
        self._shapes = _shapes()
        self._geometry = pin.GeometryModel()
        for shape in self._shapes:
            joint = self._model.getJointId(shape.joint) if shape.joint != "universe" else 0
            self._geometry.addGeometryObject(
                pin.GeometryObject(shape.name, joint, pin.SE3(shape.T), shape.solid)
            )
        for a, first in enumerate(self._shapes):
            for b in range(a):
                names = frozenset({first.name, self._shapes[b].name})
                if names not in _JOINED and not names <= set(_FIXED):
                    self._geometry.addCollisionPair(pin.CollisionPair(b, a))
        self._objects = self._geometry.createData()
        self._places = [
            [self._model.joints[self._model.getJointId(name)].idx_q for name in names]
            for names in (HEAD, *([side + joint for joint in LEG] for side in SIDES))
        ]
        self._legs = [i for i, s in enumerate(self._shapes) if s.name.endswith(_OF_LEGS)]
        self._eye = self._model.getFrameId("lower_camera")

    def posture(self, left: Array, right: Array, head: Array) -> Array:
        """Angles of all joints of the model, from legs (6,) and head (2,) rad."""
        q = np.zeros(self._model.nq)
        for places, values in zip(self._places, (head, left, right), strict=True):
            q[places] = values
        return q

    def touching(self, q: Array) -> tuple[str, str] | None:
        """Return a pair in contact, or None."""
        if not pin.computeCollisions(self._model, self._data, self._geometry, self._objects, q, True):
            return None
        for pair, result in zip(self._geometry.collisionPairs, self._objects.collisionResults, strict=True):
            if result.isCollision():
                return self._shapes[pair.first].name, self._shapes[pair.second].name
        return None

    def hidden(self, q: Array, points: Array) -> bool:
        """Whether a leg occludes any part of the convex hull of points (n, 3) m in the torso frame.

        Args:
            q: posture.
            points: corners of what the camera looks at, slightly in front of its surface.
        """
        pin.framesForwardKinematics(self._model, self._data, q)
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._objects)
        eye = np.asarray(self._data.oMf[self._eye].translation)
        corners = coal.StdVec_Vec3s()
        for point in (eye + _FROM_EYE * (points.mean(axis=0) - eye), *points):
            corners.append(point)
        sight = coal.Convex.convexHull(corners, True, "Qt")
        request, result, here = coal.CollisionRequest(), coal.CollisionResult(), coal.Transform3s()
        for i in self._legs:
            place = self._objects.oMg[i]
            there = coal.Transform3s(place.rotation, place.translation)
            result.clear()
            if coal.collide(sight, here, self._shapes[i].solid, there, request, result):
                return True
        return False


@lru_cache(maxsize=1)
def nao_bodies() -> NaoBodies:
    """The shared instance; not thread-safe."""
    return NaoBodies()
