"""Distances of points from bodies, with gradients, for many points and bodies at once.

A body is its core, grown by a ball. Boxes, cylinders, capsules and balls are sums of a box, a disc across z and a ball
(`plan.collision.covers.rounded_box`), so the signed distance from the core has a closed form: of the sum of a box and a
disc. So has the distance from the circle of a torus. The distance from a hull is coal's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import coal
import numpy as np

from arm.robot.shapes import Convex, Shape, Torus
from arm.se3 import Array, Bools, Indices
from plan.collision.covers import rounded_box
from plan.collision.narrow.coal_shapes import GJK_TOLERANCE, coal_shape

_POINT = 1e-6  # m, radius of the ball that stands for a point in coal
_TINY = 1e-300  # makes 0 / 0 a 0


class Solids(Protocol):
    """k bodies, each in a frame of its own.

    Attributes:
        ball: (k,) m, by which the core is grown.
        convex: (k,) flags; the signed distance from a convex core is a convex function. Others are circles.
        error: m, largest error of a distance.
    """

    ball: Array
    convex: Bools
    error: float

    def measure(self, which: Indices, points: Array) -> tuple[Array, Array]:
        """Return signed distances (o, n) m of points from cores, minus the depth inside, and gradients (3, o, n).

        Args:
            which: (o,) index of a body.
            points: (3, o, n) m, in its frame.
        """


class RoundedSolids:
    """Boxes, cylinders, capsules, balls and tori; frames are theirs."""

    error = 0.0

    def __init__(self, shapes: Sequence[Shape]) -> None:
        sums = [rounded_box(shape) for shape in shapes]
        self.ball = np.array([ball for _, _, _, ball in sums])
        self.convex = np.array([not isinstance(shape, Torus) for shape in shapes], dtype=bool)
        self._all_convex = bool(self.convex.all())
        self._half = np.array([half for _, half, _, _ in sums]).reshape(-1, 3).T[..., None]
        self._disc = np.array([disc for _, _, disc, _ in sums])[:, None]
        # a point within the disc is at a negative distance from its rim, which counts for a torus only
        self._least = np.where(self.convex, 0.0, -np.inf)[:, None]

    def measure(self, which: Indices, points: Array) -> tuple[Array, Array]:
        """See `Solids`."""
        over = np.abs(points) - self._half[:, which]
        out = np.maximum(over, 0.0)
        aside = np.sqrt(out[0] * out[0] + out[1] * out[1])
        rim = aside + np.minimum(np.maximum(over[0], over[1]), 0.0) - self._disc[which]
        across = np.maximum(rim, self._least[which])
        apart = np.sqrt(across * across + out[2] * out[2])
        gradient = np.empty(points.shape)
        gradient[:2] = across / (aside * apart + _TINY)
        gradient[2] = 1.0 / (apart + _TINY)
        gradient *= out
        if not (apart.all() and (self._all_convex or aside.all())):
            # inside, or on the axis of a torus: one of the shortest ways out
            inside, flat, first = apart == 0.0, over[2] >= rim, over[0] >= over[1]
            middle = aside == 0.0
            out[0] = np.where(middle, first, out[0] / (aside + _TINY))
            out[1] = np.where(middle, ~first, out[1] / (aside + _TINY))
            along = np.where(inside, ~flat, across / (apart + _TINY))
            special = inside | (middle & (across != 0.0))
            gradient[:2] = np.where(special, along * out[:2], gradient[:2])
            gradient[2] = np.where(inside, flat, gradient[2])
            apart += np.where(inside, np.minimum(np.maximum(rim, over[2]), 0.0), 0.0)
        gradient *= np.copysign(1.0, points)
        return apart, gradient


class HullSolids:
    """Convex hulls; frames are theirs."""

    error = 2e-6

    def __init__(self, shapes: Sequence[Convex]) -> None:
        self.ball, self.convex = np.zeros(len(shapes)), np.ones(len(shapes), dtype=bool)
        self._hulls = [coal_shape(shape) for shape in shapes]
        self._request = coal.DistanceRequest()
        self._request.gjk_tolerance = self._request.epa_tolerance = GJK_TOLERANCE
        self._point = coal.Sphere(_POINT)

    def measure(self, which: Indices, points: Array) -> tuple[Array, Array]:
        """See `Solids`."""
        value, gradient = np.empty(points.shape[1:]), np.empty(points.shape)
        still, at, result = coal.Transform3s(), coal.Transform3s(), coal.DistanceResult()
        for i, hull in enumerate(which.tolist()):
            for j in range(points.shape[2]):
                at.setTranslation(points[:, i, j])
                result.clear()
                distance = coal.distance(self._hulls[hull], still, self._point, at, self._request, result)
                value[i, j], gradient[:, i, j] = distance + _POINT, result.normal
        return value, gradient
