"""Shapes as coal has them."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import coal
import numpy as np

from arm.robot.shapes import Box, Capsule, Convex, Cylinder, Shape, Sphere

GJK_TOLERANCE = 1e-7
GJK_ERROR = 1e-6  # m, more than the largest error of a distance that was measured


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
