"""Pairs of bodies in Pinocchio and coal: exact distances, and collision checks through a broadphase."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from arm.robot.model import LinkBody
from arm.robot.shapes import Box, Capsule, Convex, Cylinder, Shape, Sphere
from arm.se3 import Array, Indices
from plan.budget import spend

GJK_TOLERANCE = 1e-7


class PairGeometry:
    """The bodies and pairs of one world as a Pinocchio geometry model.

    Not thread-safe: it contains Pinocchio's workspace.

    Args:
        model: Pinocchio model of the arm.
        parts: all bodies.
        pairs: (p, 2) indices into `parts`; the body with the lower joint comes first.
        paddings: (p,) subtracted from the distance of each pair, m.

    Attributes:
        placed: result of Pinocchio's `computeDistance` for each pair, by `index`.
        index: (p,) index of each pair in the geometry model.
    """

    def __init__(self, model: Any, parts: Sequence[LinkBody], pairs: Indices, paddings: Array) -> None:
        # by joints, so that the first body of each pair has the lower number, as Pinocchio's matrix of pairs wants it
        joints = np.array([part.joint for part in parts], dtype=np.intp)
        order = np.argsort(joints, kind="stable")
        number = np.empty_like(order)
        number[order] = np.arange(len(order))
        first, second = number[pairs].T
        checked = np.zeros((len(parts), len(parts)), dtype=bool)
        checked[first, second] = True

        self._model, self._data = model, model.createData()
        self._objects = [
            _geometry_object(body.name, body.joint, body.shape, body.T_joint_body.tobytes())
            for body in (parts[i] for i in order.tolist())
        ]
        self._geometry = _geometry_model(self._objects)
        self._geometry.setCollisionPairs(checked)
        self.index: Indices = self._geometry.collisionPairMapping[first, second].astype(np.intp)
        self._placements = pin.GeometryData(self._geometry)
        self.results = self._placements.distanceResults
        # fresh requests: Pinocchio's own start GJK from the previous result, so that the last digits of a distance
        # would depend on earlier calls
        distance, collision = coal.DistanceRequest(), coal.CollisionRequest()
        for request in (distance, collision):
            request.gjk_tolerance = request.epa_tolerance = GJK_TOLERANCE
        distances, collisions = self._placements.distanceRequests, self._placements.collisionRequests
        for i in range(len(pairs)):
            distances[i], collisions[i] = distance, collision
        self._padding = np.zeros(checked.shape)
        self._padding[first, second] = paddings
        self._most_padding = float(paddings.max(initial=0.0))
        # a manager inflates bodies by the margins of their pairs, so it needs two of them
        self._still = min(int((joints == 0).sum()), len(parts) - 2)
        self._margin: float | None = None

    def place(self, q: Array) -> None:
        """Place all bodies at configuration q (n,) rad."""
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._placements, q)

    def distance(self, index: int) -> Any:
        """Return coal's result for one pair (a value of `index`) where `place` put it; the next call overwrites it."""
        return pin.computeDistance(self._geometry, self._placements, index)

    def too_near(self, clearance: float) -> Callable[[Array], bool]:
        """Return a function of q (n,): whether some pair is closer than `clearance` m, paddings taken off.

        Pinocchio's managers place all bodies anew and walk through all pairs each time. Here what stands still is
        placed once, in a manager of its own.
        """
        model, data, geometry, placements = self._model, self._data, self._geometry, self._placements
        margins = self._padding + clearance
        nearest = pin.CollisionCallBackDefault(geometry, placements, True)
        still, moving, moved = self._managers(clearance)
        place = pin.updateGeometryPlacements

        def test(q: Array) -> bool:
            spend(1.0)
            if self._margin != clearance:
                placements.setSecurityMargins(geometry, margins, True, False)
                self._margin = clearance
            place(model, data, *moved, q)
            place(model, data, geometry, placements)  # at the same q
            moving.update()
            return bool(moving.collide(nearest) or still.collide(moving, nearest))

        return test

    def _managers(self, clearance: float) -> tuple[Any, Any, tuple[Any, Any]]:
        """Return broadphase managers of the bodies that stand still and of those that move, and the data of the latter.

        Bodies keep their numbers: in the second, those that stand still take no part.
        """
        still = _geometry_model(self._objects[: self._still])
        moving = _geometry_model(self._objects)
        for i in range(self._still):
            moving.geometryObjects[i].disableCollision = True
        # boxes of moving bodies are inflated by all of the largest margin, the others not
        request = coal.CollisionRequest()
        request.security_margin = 2.0 * max(clearance + self._most_padding, 0.0)
        for i in range(self._still, len(self._objects) - 1):
            moving.addCollisionPair(pin.CollisionPair(i, i + 1))
        manager = pin.BroadPhaseManager_SSaPCollisionManager
        data = [pin.GeometryData(still), pin.GeometryData(moving)]
        for i in range(len(moving.collisionPairs)):
            data[1].collisionRequests[i] = request
        managers = [manager(self._model, part, of) for part, of in zip((still, moving), data, strict=True)]
        pin.updateGeometryPlacements(self._model, self._data, still, data[0], pin.neutral(self._model))
        managers[0].update()
        return managers[0], managers[1], (moving, data[1])


@lru_cache(maxsize=1024)
def _geometry_object(name: str, joint: int, shape: Shape, pose: bytes) -> Any:
    """Return a body as a geometry object; models copy it."""
    T_joint_body = np.frombuffer(pose).reshape(4, 4).copy()
    return pin.GeometryObject(name, joint, pin.SE3(T_joint_body), coal_shape(shape))


def _geometry_model(objects: Sequence[Any]) -> Any:
    model = pin.GeometryModel()
    for body in objects:
        model.addGeometryObject(body)
    return model


@lru_cache(maxsize=1024)
def coal_shape(shape: Shape) -> Any:
    """Return the shape as a coal geometry, in its own frame."""
    match shape:
        case Box(size):
            return coal.Box(*size)
        case Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case Sphere(radius):
            return coal.Sphere(radius)
        case Capsule(radius, length):
            return coal.Capsule(radius, length)
        case Convex(points):
            corners = coal.StdVec_Vec3s()
            corners.extend(np.array(points))
            return coal.Convex.convexHull(corners, True, "Qt")
