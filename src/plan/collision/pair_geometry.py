"""Pairs of bodies in Pinocchio and coal: exact distances, and collision checks through a broadphase."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from arm.robot.model import LinkBody
from arm.robot.shapes import Shape, Torus
from arm.se3 import Array, Indices
from plan.budget import spend
from plan.collision.narrow.coal_shapes import GJK_ERROR, GJK_TOLERANCE, coal_shape
from plan.collision.narrow.torus_pairs import TorusDistance, TorusPairs, covered

_FEW_TESTS = 25  # of pairs of a torus: they take as long as making the capsules that replace most tests


class PairGeometry:
    """The bodies and pairs of one world as a Pinocchio geometry model, and its pairs of a torus, which coal lacks.

    Not thread-safe: it contains Pinocchio's workspace.

    Args:
        model: Pinocchio model of the arm.
        parts: all bodies.
        pairs: (p, 2) indices into `parts`; the body with the lower joint comes first.
        paddings: (p,) subtracted from the distance of each pair, m.
    """

    def __init__(self, model: Any, parts: Sequence[LinkBody], pairs: Indices, paddings: Array) -> None:
        # by joints, so that the first body of each pair has the lower number, as Pinocchio's matrix of pairs wants it
        joints = np.array([part.joint for part in parts], dtype=np.intp)
        is_torus = np.array([isinstance(part.shape, Torus) for part in parts], dtype=bool)
        order = np.argsort(joints, kind="stable")
        order = order[~is_torus[order]]
        number = np.empty_like(joints)
        number[order] = np.arange(len(order))
        of_torus = is_torus[pairs].any(axis=1)
        first, second = number[pairs[~of_torus]].T
        checked = np.zeros((len(order), len(order)), dtype=bool)
        checked[first, second] = True

        self._model, self._data = model, model.createData()
        self._objects = [
            _geometry_object(body.name, body.joint, body.shape, body.T_joint_body.tobytes())
            for body in (parts[i] for i in order.tolist())
        ]
        self._geometry = _geometry_model(self._objects)
        self._geometry.setCollisionPairs(checked)
        # of each pair: in the geometry model, or -1 - i for pair i of a torus
        self._index = np.empty(len(pairs), dtype=np.intp)
        self._index[~of_torus] = self._geometry.collisionPairMapping[first, second]
        self._index[of_torus] = -1 - np.arange(of_torus.sum())
        self._tori: TorusPairs | None = None
        if of_torus.any():
            self._tori = TorusPairs(parts, pairs[of_torus])
            self._torus_pairs = parts, pairs[of_torus], paddings[of_torus]
        self._placements = pin.GeometryData(self._geometry)
        # fresh requests: Pinocchio's own start GJK from the previous result, so that the last digits of a distance
        # would depend on earlier calls
        distance, collision = coal.DistanceRequest(), coal.CollisionRequest()
        for request in (distance, collision):
            request.gjk_tolerance = request.epa_tolerance = GJK_TOLERANCE
        distances, collisions = self._placements.distanceRequests, self._placements.collisionRequests
        for i in range(len(first)):
            distances[i], collisions[i] = distance, collision
        self._padding = np.zeros(checked.shape)
        self._padding[first, second] = paddings[~of_torus]
        self._most_padding = float(paddings[~of_torus].max(initial=0.0))
        # a manager inflates bodies by the margins of their pairs, so it needs two of them
        self._still = min(int((joints[order] == 0).sum()), len(order) - 2)
        self._margin: float | None = None

    def distances(self, q: Array, pairs: Indices) -> Iterator[Any]:
        """Yield coal's result for each of k pairs at q (n,), or a `TorusDistance`, which has the same members.

        The next result for the same pair overwrites it.
        """
        index = self._index[pairs]
        tori: Iterator[TorusDistance] = iter(())
        if self._tori is not None and (index < 0).any():
            tori = self._tori.distances(self._poses(self._tori, q)[None], -1 - index[index < 0])
        geometry, placements, distance = self._geometry, self._placements, pin.computeDistance
        pin.updateGeometryPlacements(self._model, self._data, geometry, placements, q)
        for i in index.tolist():
            yield next(tori) if i < 0 else distance(geometry, placements, i)

    def witnesses(self, q: Array, rows: Indices, pairs: Indices, least: Array) -> tuple[Array, Array, Array]:
        """Return distances (k,), normals (k, 3) and points (k, 3) of the outer bodies of pairs at some configurations.

        They end with the first distance below its `least`.

        Args:
            q: (m, n) rad.
            rows, pairs: (k,) indices of configurations, in ascending order, and of pairs.
            least: (k,) m.
        """
        index, end = self._index[pairs], len(pairs)
        values, normals, points = np.empty(end), np.empty((end, 3)), np.empty((end, 3))
        of_torus = np.flatnonzero(index < 0)
        if self._tori is not None and len(of_torus):
            used, row = np.unique(rows[of_torus], return_inverse=True)
            poses = np.array([self._poses(self._tori, at) for at in q[used]])
            found = self._tori.measured(poses, row, -1 - index[of_torus])
            values[of_torus], normals[of_torus], points[of_torus] = found
            below = of_torus[found[0] < least[of_torus]]
            end = int(below[0]) + 1 if len(below) else end
        geometry, placements, placed = self._geometry, self._placements, -1
        distance = pin.computeDistance
        others = np.flatnonzero(index[:end] >= 0)
        for k, row, i in zip(others.tolist(), rows[others].tolist(), index[others].tolist(), strict=True):
            if row != placed:
                pin.updateGeometryPlacements(self._model, self._data, geometry, placements, q[row])
                placed = row
            result = distance(geometry, placements, i)
            # copied, because the next call for this pair overwrites the result
            values[k], normals[k], points[k] = result.min_distance, result.normal, result.getNearestPoint2()
            if values[k] < least[k]:
                end = k + 1
                break
        return values[:end], normals[:end], points[:end]

    def _poses(self, tori: TorusPairs, q: Array) -> Array:
        """Return the poses (joints, 4, 4) of the joints of pairs of a torus."""
        pin.forwardKinematics(self._model, self._data, q)
        return np.array([self._data.oMi[joint].homogeneous for joint in tori.joints])

    def too_near(self, clearance: float) -> Callable[[Array], bool]:
        """Return a function of q (n,): whether some pair is closer than `clearance` m, paddings taken off."""
        # the managers need a pair of bodies
        others = self._too_near_of_coal(clearance) if len(self._geometry.collisionPairs) else lambda q: False
        if self._tori is None:
            return others
        tori, limits = self._tori, self._torus_pairs[2] + clearance
        exact, capsules = 0, None

        def test(q: Array) -> bool:
            nonlocal exact, capsules
            if others(q):
                return True
            if capsules is None and exact == _FEW_TESTS:
                capsules = self._too_near_of_capsules(clearance)
            if capsules is not None:
                outer, inner = capsules
                if not outer(q):
                    return False
                if inner(q):
                    return True
            exact += 1
            return tori.too_near(self._poses(tori, q)[None], limits)

        return test

    def _too_near_of_capsules(self, clearance: float) -> list[Callable[[Array], bool]]:
        """Return `too_near` of capsules around tori and of ones inside: what is false and what is true of the tori."""
        found = covered(*self._torus_pairs)
        return [
            PairGeometry(self._model, found.parts, found.pairs, found.paddings)._too_near_of_coal(margin)
            for margin in (clearance + GJK_ERROR, clearance - 2.0 * found.excess - GJK_ERROR)
        ]

    def _too_near_of_coal(self, clearance: float) -> Callable[[Array], bool]:
        """Return `too_near` of the pairs that coal has.

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
