"""A camera's pose from what a tape measures: where the lens is, and what it looks at."""

from __future__ import annotations

import numpy as np

from arm.errors import InputError
from arm.numerics.products import mul, norm
from arm.se3 import Array

_LEAST = 1e-3  # m between lens and target; sine of the angle between line of sight and the image's right


def looking_pose(position: Array, looks_at: Array, right_azimuth: float) -> Array:
    """Return T_base_camera of a camera that looks at a point.

    Args:
        position: of the lens (3,), m.
        looks_at: a point on the line of sight, in the middle of the image (3,), m.
        right_azimuth: azimuth of the image's right side about the base's z, rad; 0 along x, pi/2 along y. Its part
            across the line of sight counts.

    Raises:
        InputError: both points are the same, or the image's right side would be along the line of sight.
    """
    sight = looks_at - position
    away = norm(sight)
    if away < _LEAST:
        raise InputError("the camera looks at its own position", distance_mm=1e3 * away)
    z = sight / away
    right = np.array([np.cos(right_azimuth), np.sin(right_azimuth), 0.0])
    across = right - mul(right, z) * z
    if norm(across) < _LEAST:
        raise InputError("the image's right side is along the line of sight", sine=norm(across))
    x = across / norm(across)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.stack([x, np.cross(z, x), z], axis=1), position
    return T
