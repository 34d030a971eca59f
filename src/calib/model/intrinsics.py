"""The nine intrinsics as one vector."""

from __future__ import annotations

import numpy as np

from arm.se3 import Array, frozen
from vision.camera.model import Camera

NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
UNITS = ("px", "px", "px", "px", "", "", "", "", "")
COUNT = len(NAMES)


def vector_of(camera: Camera) -> Array:
    """Intrinsics of a camera without skew as a vector (9,), in the order of `NAMES`."""
    K = camera.K
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *camera.distortion])


def camera_of(vector: Array, size: tuple[int, int]) -> Camera:
    """Camera with these intrinsics, at the origin."""
    fx, fy, cx, cy = vector[:4]
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    return Camera(K, vector[4:], size, frozen(np.eye(4)))


def pinhole(focal: float, size: tuple[int, int]) -> Camera:
    """Camera without distortion, at the origin: focal length in px, and the principal point in the image's middle."""
    return camera_of(np.array([focal, focal, *((np.array(size) - 1.0) / 2.0), *np.zeros(5)]), size)
