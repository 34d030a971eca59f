"""Pairs of bodies one of which is a torus: distances with witness points, and collision checks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf
from typing import NamedTuple

import numpy as np

from arm.numerics.products import mul
from arm.robot.model import LinkBody
from arm.robot.shapes import Body, Capsule, Convex, Torus, simple_parts
from arm.se3 import Array, Indices, frozen
from plan.budget import TORUS_CHECKS, spend
from plan.collision.narrow.circle import Circles, nearest
from plan.collision.narrow.solids import HullSolids, RoundedSolids, Solids

_FEW = 4  # pairs of one configuration that are computed at first


class TorusDistance(NamedTuple):
    """Distance of one pair, with those members of coal's result that are used.

    Attributes:
        min_distance: m. Of bodies that overlap: minus the radius of the tube, minus the depth of the circle's deepest
            point in the other body: the sign is right, but it is not the penetration depth.
        normal: unit vector (3,) from the inner body to the outer one, in the base frame.
        inner, outer: nearest points (3,) m of the two bodies, in the base frame.
    """

    min_distance: float
    normal: Array
    inner: Array
    outer: Array

    def getNearestPoint1(self) -> Array:
        """Return the point of the inner body."""
        return self.inner

    def getNearestPoint2(self) -> Array:
        """Return the point of the outer body."""
        return self.outer


class _Columns(NamedTuple):
    """The members of `TorusDistance` of k pairs: (k,) m, and (k, 3) each."""

    min_distance: Array
    normal: Array
    inner: Array
    outer: Array


class TorusPairs:
    """Pairs of a torus and another body. Of two tori the smaller one is the torus, and the other one the body.

    Args:
        parts: bodies.
        pairs: (p, 2) indices into `parts`; the inner body comes first.

    Attributes:
        joints: that carry bodies of the pairs. Methods take their poses in the base frame, (m, joints, 4, 4), at m
            configurations.
    """

    def __init__(self, parts: Sequence[LinkBody], pairs: Indices) -> None:
        first = np.array([_torus_first(parts[a], parts[b]) for a, b in pairs.tolist()], dtype=bool)
        torus, other = np.where(first, pairs.T, pairs.T[::-1])
        self._outwards = np.where(first, -1.0, 1.0)  # of the direction from the other body to the torus
        joint = np.array([part.joint for part in parts], dtype=np.intp)
        self.joints = sorted(set(joint[pairs].ravel().tolist()))
        self._joint = np.searchsorted(self.joints, joint[np.stack([torus, other])])
        pose = np.array([part.T_joint_body for part in parts])
        # of the circle: the directions of two half axes, and its centre
        self._circle, self._T_joint_other = pose[torus][..., [0, 1, 3]], pose[other]
        sizes = [vars(parts[i].shape) for i in torus.tolist()]
        self._radius, self._tube = np.array([[size["radius"], size["tube"]] for size in sizes]).T
        shapes = [parts[i].shape for i in other.tolist()]
        self._is_hull = np.array([isinstance(shape, Convex) for shape in shapes], dtype=bool)
        self._rounded = RoundedSolids([shape for shape in shapes if not isinstance(shape, Convex)])
        self._hulls = HullSolids([shape for shape in shapes if isinstance(shape, Convex)])
        self._groups: list[tuple[Solids, Indices]] = [
            (self._rounded, np.flatnonzero(~self._is_hull)),
            (self._hulls, np.flatnonzero(self._is_hull)),
        ]
        self._body = np.where(self._is_hull, np.cumsum(self._is_hull), np.cumsum(~self._is_hull)) - 1

    def distances(self, poses: Array, pairs: Indices) -> Iterator[TorusDistance]:
        """Yield the distances of pairs (k,) at the one configuration of `poses`.

        At first only a few are computed, which often suffice; those from hulls are computed one by one.
        """
        is_hull = self._is_hull[pairs].tolist()
        rounded = [i for i, hull in enumerate(is_hull) if not hull]
        parts, ready = [rounded[:_FEW], rounded[_FEW:]], dict[int, TorusDistance]()
        for i, hull in enumerate(is_hull):
            if i not in ready:
                some = [i] if hull else parts.pop(0)
                found = self._at(self._of(hull), poses, np.zeros(len(some), dtype=np.intp), pairs[some])
                each = zip(found.min_distance.tolist(), found.normal, found.inner, found.outer, strict=True)
                ready |= dict(zip(some, (TorusDistance(*one) for one in each), strict=True))
            yield ready[i]

    def measured(self, poses: Array, rows: Indices, pairs: Indices) -> tuple[Array, Array, Array]:
        """Return distances (k,), normals (k, 3) and points (k, 3) of the outer bodies of pairs at some configurations.

        Args:
            poses: (m, joints, 4, 4).
            rows, pairs: (k,) indices of configurations and of pairs.
        """
        distance, normal, outer = np.empty(len(pairs)), np.empty((len(pairs), 3)), np.empty((len(pairs), 3))
        for hull in (False, True):
            some = np.flatnonzero(self._is_hull[pairs] == hull)
            if len(some):
                found = self._at(self._of(hull), poses, rows[some], pairs[some])
                distance[some], normal[some], outer[some] = found.min_distance, found.normal, found.outer
        return distance, normal, outer

    def _of(self, hull: bool) -> Solids:
        return self._hulls if hull else self._rounded

    def _at(self, solids: Solids, poses: Array, rows: Indices, pairs: Indices) -> _Columns:
        """Return distances of pairs (k,) from these solids at configurations (k,)."""
        spend(TORUS_CHECKS * len(pairs))
        T_base_other, circles = self._circles(poses, rows, pairs)
        found = nearest(circles, solids)
        local = np.stack([found.point, found.away], axis=1).T
        on_circle, away = mul(T_base_other[:, :3, :3], local.swapaxes(1, 2)).transpose(2, 0, 1)
        on_circle = on_circle + T_base_other[:, :3, 3]
        # of the circle from the surface of the other body, and of the torus
        gap, tube = found.distance - solids.ball[circles.body], self._tube[pairs]
        outwards = self._outwards[pairs]
        # the ball of the torus reaches from the circle to the nearest point of the torus
        inner, outer = np.where(outwards > 0.0, [gap, tube], [tube, gap])
        points = (on_circle - reach[:, None] * away for reach in (inner, outer))
        return _Columns(gap - tube, outwards[:, None] * away, *points)

    def too_near(self, poses: Array, limits: Array) -> bool:
        """Return whether some pair is closer than its limit (p,) m at the one configuration of `poses`."""
        spend(TORUS_CHECKS * len(limits))
        for solids, pairs in self._groups:
            if not len(pairs):
                continue
            _, circles = self._circles(poses, np.zeros_like(pairs), pairs)
            within = limits[pairs] + self._tube[pairs] + solids.ball[circles.body]
            if (nearest(circles, solids, within).distance < within).any():
                return True
        return False

    def _circles(self, poses: Array, rows: Indices, pairs: Indices) -> tuple[Array, Circles]:
        """Return the poses (k, 4, 4) of the other bodies in the base frame, and the circles in the frames of these."""
        torus, other = self._joint[:, pairs]
        circle = mul(poses[rows, torus], self._circle[pairs])[:, :3]
        T_base_other = mul(poses[rows, other], self._T_joint_other[pairs])
        circle[..., 2] -= T_base_other[:, :3, 3]
        x, y, centre = mul(T_base_other[:, :3, :3].swapaxes(1, 2), circle).transpose(2, 1, 0)
        radius = self._radius[pairs]
        return T_base_other, Circles(centre, radius * x, radius * y, radius, self._body[pairs])


def _torus_first(a: LinkBody, b: LinkBody) -> bool:
    """Return whether the first body of a pair is the one that is taken as the torus."""
    radius = [part.shape.radius if isinstance(part.shape, Torus) else inf for part in (a, b)]
    return radius[0] < radius[1]


@dataclass(frozen=True, eq=False)
class Covered:
    """Pairs of tori with capsules that cover these in their place.

    Attributes:
        parts, pairs, paddings: as of a world.
        excess: m, by which the capsules reach out of the tori at most; those of a radius less by twice that are inside.
    """

    parts: list[LinkBody]
    pairs: Indices
    paddings: Array
    excess: float


def covered(parts: Sequence[LinkBody], pairs: Indices, paddings: Array) -> Covered:
    """Return capsules in the place of each torus of pairs (p, 2), indices into `parts`, with paddings (p,) m."""
    found, places, excess = list[LinkBody](), dict[int, range](), 0.0
    for index in np.unique(pairs).tolist():
        part = parts[index]
        capsules = simple_parts(part.shape, covering=True)
        places[index] = range(len(found), len(found) + len(capsules))
        for shape, at in capsules:
            found.append(replace(part, shape=shape, T_joint_body=frozen(mul(part.T_joint_body, at))))
            if isinstance(part.shape, Torus) and isinstance(shape, Capsule):
                excess = max(excess, shape.radius - part.shape.tube)
    each = [(*both, i) for i, (a, b) in enumerate(pairs.tolist()) for both in product(places[a], places[b])]
    indices = np.array(each, dtype=np.intp).reshape(-1, 3)
    return Covered(found, indices[:, :2], paddings[indices[:, 2]], excess)


def torus_distance(inner: Body, outer: Body) -> TorusDistance:
    """Return the distance of two bodies at their poses; at least one is a torus."""
    parts = [LinkBody(body.name, 0, body.shape, body.T_base_body) for body in (inner, outer)]
    return next(TorusPairs(parts, np.array([[0, 1]])).distances(np.eye(4)[None, None], np.array([0])))
