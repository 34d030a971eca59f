"""The nine intrinsics as one vector, and the derivative of the pixels with respect to them."""

from __future__ import annotations

import numpy as np

from arm.se3 import Array, frozen
from vision.camera.distortion import distort
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


def lens_parameter_jacobian(camera: Camera, points_camera: Array) -> Array:
    """Derivative of the pixels by the intrinsics: points (..., 3) m in the camera frame to (..., 2, 9)."""
    on_plane = points_camera[..., :2] / points_camera[..., 2:]
    x, y = on_plane[..., 0], on_plane[..., 1]
    r2 = x * x + y * y
    J = np.zeros((*x.shape, 2, COUNT))
    distorted = distort(camera.distortion, on_plane)
    J[..., 0, 0], J[..., 1, 1] = distorted[..., 0], distorted[..., 1]
    J[..., 0, 2] = J[..., 1, 3] = 1.0
    for column, power in ((4, r2), (5, r2**2), (8, r2**3)):
        J[..., column] = on_plane * power[..., None]
    J[..., 0, 6], J[..., 1, 6] = 2.0 * x * y, r2 + 2.0 * y * y
    J[..., 0, 7], J[..., 1, 7] = r2 + 2.0 * x * x, 2.0 * x * y
    J[..., 4:] *= np.diag(camera.K)[:2][:, None]
    return J
