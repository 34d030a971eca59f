"""The ray of every pixel of a camera, with exact distortion, and rays between the pixels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from arm.se3 import Array
from vision.camera import Camera


@dataclass(frozen=True, eq=False)
class PixelRays:
    """Undistorted image coordinates on the plane z = 1 at the pixels' centres, (h, w), and their slopes per pixel."""

    x: Array
    y: Array
    x_per_u: Array
    x_per_v: Array
    y_per_u: Array
    y_per_v: Array

    def between(self, row: Array, column: Array, du: Array, dv: Array) -> tuple[Array, Array]:
        """Coordinates at offsets (du, dv) px from the centres of pixels; linear, which is exact to 3e-5 px."""
        x = self.x[row, column] + self.x_per_u[row, column] * du + self.x_per_v[row, column] * dv
        y = self.y[row, column] + self.y_per_u[row, column] * du + self.y_per_v[row, column] * dv
        return x, y


def pixel_rays(camera: Camera) -> PixelRays:
    """The rays of a camera; kept for the next image, because the inverse distortion costs a second."""
    return _rays(camera.digest, _Keyed(camera))


class _Keyed:
    """Carries the camera past the cache, which goes by the digest alone."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera

    def __hash__(self) -> int:
        return 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Keyed)


@lru_cache(maxsize=2)
def _rays(digest: str, keyed: _Keyed) -> PixelRays:
    width, height = keyed.camera.size
    u, v = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    points = keyed.camera.normalised(np.stack([u, v], axis=-1))
    x, y = np.ascontiguousarray(points[..., 0]), np.ascontiguousarray(points[..., 1])
    x_per_v, x_per_u = np.gradient(x)
    y_per_v, y_per_u = np.gradient(y)
    return PixelRays(x, y, x_per_u, x_per_v, y_per_u, y_per_v)
