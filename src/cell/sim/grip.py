"""How a cube lies between the jaws that grip it."""

from __future__ import annotations

import numpy as np

from arm.numerics.products import mul, norm
from arm.se3 import Array, rotation, transform


def between_jaws(T_tool_cube: Array) -> Array:
    """Pose of a cube, 4x4, that jaws moving along the tool's y axis have centred and aligned with their faces.

    Where it lies along the fingers, and its rotation about the jaws' travel, stay as they were.
    """
    faces = T_tool_cube[1, :3]  # the jaws' travel in the cube's frame
    face = int(np.argmax(np.abs(faces)))
    normal = np.sign(faces[face]) * T_tool_cube[:3, face]
    axis = np.cross(normal, (0.0, 1.0, 0.0))
    angle = float(np.arctan2(norm(axis), normal[1]))
    turned = mul(rotation(axis * (angle / norm(axis) if norm(axis) > 0.0 else 0.0)), T_tool_cube[:3, :3])
    return transform(turned, T_tool_cube[:3, 3] * (1.0, 0.0, 1.0))


def angle_to_jaws(R: Array) -> float:
    """Angle, rad, between the jaws' travel (y) and a cube's R (3, 3), however it is rotated about that axis."""
    return float(np.arccos(np.clip(np.abs(R[1]).max(), -1.0, 1.0)))


def angle_to_square(R: Array) -> float:
    """Smallest rotation, rad, from a cube's R (3, 3) to an orientation equivalent to the identity."""
    nearest = np.zeros((3, 3))
    for axis in range(3):
        column = int(np.argmax(np.abs(R[:, axis])))
        nearest[column, axis] = np.sign(R[column, axis])
    return float(np.arccos(np.clip((np.trace(mul(nearest.T, R)) - 1.0) / 2.0, -1.0, 1.0)))
