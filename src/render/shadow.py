"""Soft shadow of the lamp: the fraction of its light that is hidden from the points in view.

The first two moments of a depth map from the lamp are blurred. Then Chebyshev's inequality bounds the fraction of the
lamp that is visible from a point (W. Donnelly and A. Lauritzen, "Variance shadow maps", 2006). The blur,
`Light.penumbra`, represents the size of the lamp.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from arm.se3 import Array, apply, inverse, transform
from render.first_hit import first_hits, in_view
from render.light import Light
from render.rays import Floats, PixelRays
from render.solids import Solid
from render.surface import sampled

CELL = 2.5e-3  # m, pitch of the depth map at the points in view
DEPTH_NOISE = 1.5e-3  # m, smaller differences of depth cast no shadow
MOST_CELLS = 1200  # per side


class Shadow:
    """Shadow of the lamp in the view of one camera.

    Args:
        solids: the solids that cast and receive shadows.
        light: the light in the cell.
        T_base_camera: pose of the camera, 4x4.
        rays: rays of its pixels.
        depth: depth of their first hits, m, same shape.
    """

    def __init__(
        self, solids: Sequence[Solid], light: Light, T_base_camera: Array, rays: PixelRays, depth: Floats
    ) -> None:
        points = _some_points(T_base_camera, rays, depth)
        T_base_lamp = _looking_at(np.asarray(light.lamp), points.mean(axis=0))
        self._T_lamp_camera = inverse(T_base_lamp) @ T_base_camera
        lamp_points = apply(inverse(T_base_lamp), points)
        on_plane = lamp_points[:, :2] / lamp_points[:, 2:]
        self._reference = float(np.median(lamp_points[:, 2]))  # moments about it fit single precision
        self._cell = CELL / self._reference
        margin = 4.0 * light.penumbra / CELL * self._cell
        self._low = on_plane.min(axis=0) - margin
        columns, rows = np.minimum(
            np.ceil((on_plane.max(axis=0) + margin - self._low) / self._cell), MOST_CELLS
        ).astype(int)
        x, y = np.meshgrid(
            self._low[0] + self._cell * np.arange(columns), self._low[1] + self._cell * np.arange(rows)
        )
        lamp_rays = PixelRays(x.astype(np.float32), y.astype(np.float32))
        found = first_hits(in_view(solids, T_base_lamp, lamp_rays), T_base_lamp, lamp_rays).depth
        offset = np.where(np.isfinite(found), found - np.float32(self._reference), np.float32(1.0))
        sigma = light.penumbra / CELL
        self._mean, self._square = (
            np.asarray(cv2.GaussianBlur(f, (0, 0), sigma), dtype=np.float32)
            for f in (offset, offset * offset)
        )

    def hidden(self, rays: PixelRays, depth: Floats) -> Floats:
        """Return the fraction of the lamp, 0 to 1, hidden from points at `depth` m on the camera's rays, any shape."""
        R, t = self._T_lamp_camera[:3, :3].astype(np.float32), self._T_lamp_camera[:3, 3].astype(np.float32)
        finite = np.where(np.isfinite(depth), depth, np.float32(1.0))
        px, py = finite * rays.x, finite * rays.y
        x, y, z = (R[i, 0] * px + R[i, 1] * py + (R[i, 2] * finite + t[i]) for i in range(3))
        columns = (x / z - np.float32(self._low[0])) / np.float32(self._cell)
        rows = (y / z - np.float32(self._low[1])) / np.float32(self._cell)
        mean, square = (sampled(f, columns, rows) for f in (self._mean, self._square))
        behind = z - np.float32(self._reference) - mean - np.float32(DEPTH_NOISE)
        variance = np.maximum(square - mean * mean, np.float32(DEPTH_NOISE**2))
        hidden = np.where(behind > 0.0, behind * behind / (variance + behind * behind), np.float32(0.0))
        return np.where(np.isfinite(depth), hidden, np.float32(0.0))


def _some_points(T_base_camera: Array, rays: PixelRays, depth: Floats) -> Array:
    """Return points (n, 3) m, base frame, in view at a coarse grid of pixels; if none, one below the camera."""
    grid = np.s_[::20, ::20]
    x, y, z = rays.x[grid], rays.y[grid], depth[grid]
    met = np.isfinite(z)
    if not met.any():
        return T_base_camera[None, :3, 3] - (0.0, 0.0, 1.0)
    z = z[met].astype(float)
    return apply(T_base_camera, np.stack([x[met] * z, y[met] * z, z], axis=-1))


def _looking_at(eye: Array, target: Array) -> Array:
    """Return the pose of a camera at `eye` looking at `target`, both (3,) m."""
    z = (target - eye) / np.linalg.norm(target - eye)
    x = np.cross(z, (0.0, 1.0, 0.0) if abs(z[1]) < 0.9 else (1.0, 0.0, 0.0))
    x /= np.linalg.norm(x)
    return transform(np.stack([x, np.cross(z, x), z], axis=-1), eye)
