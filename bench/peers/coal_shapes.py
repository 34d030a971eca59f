"""Bodies as coal knows them, for judges that use nothing of the planner."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np

from arm.robot.shapes import Box, Capsule, Cylinder, Shape, Sphere
from arm.se3 import Array


def coal_shape(shape: Shape) -> Any:
    """Return a shape."""
    match shape:
        case Box(size):
            return coal.Box(*size)
        case Cylinder(radius, length):
            return coal.Cylinder(radius, length)
        case Capsule(radius, length):
            return coal.Capsule(radius, length)
        case Sphere(radius):
            return coal.Sphere(radius)
    raise TypeError(f"no shape of coal for {shape}")


def coal_transform(T: Array) -> Any:
    """Return a pose (4, 4)."""
    return coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3]))
