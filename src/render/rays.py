"""Rays of a camera: the point of each pixel on the plane z = 1 of the camera frame, and the same rays in other frames.

The parameter of a ray is the depth along the camera's z, so depths of different bodies compare directly. Single
precision resolves 1e-7 m at 1.2 m, some 5e-4 px of the lab's camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter

from arm.se3 import Array, Indices, frozen
from vision.camera.model import Camera

Floats = npt.NDArray[np.float32]

GRID_PX = 16  # undistortion is smooth: cubic splines with this pitch are accurate to 1e-5 px
CELLS = 2.0  # of that grid over which a displacement of the image changes


@dataclass(frozen=True, eq=False)
class PixelRays:
    """Points (x, y) on the plane z = 1 seen by the pixel centres, two arrays (h, w)."""

    x: Floats
    y: Floats


@dataclass(frozen=True, eq=False)
class SubpixelRays:
    """Rays (x, y) of selected pixels with their derivatives, (2, n) each, to move them inside those pixels."""

    centres: Floats
    per_column: Floats
    per_row: Floats

    def moved(self, columns: float, rows: float) -> PixelRays:
        """Return rays offset from the pixel centres, px; linear, accurate to 3e-5 px inside a pixel."""
        return PixelRays(
            *(self.centres + self.per_column * np.float32(columns) + self.per_row * np.float32(rows))
        )


def pixel_rays(camera: Camera, displaced: Array | None = None) -> PixelRays:
    """Return the rays of all pixels: undistorted on a grid, splines between. Arrays of a still image are read-only.

    Args:
        camera: whose pixels.
        displaced: px by which each point of the image has moved, see `smooth_displacement`.
    """
    if displaced is not None:
        return _splined(camera, displaced)
    return _of_lens(tuple(camera.K.ravel().tolist()), tuple(camera.distortion.tolist()), camera.size)


@lru_cache(maxsize=2)
def _of_lens(K: tuple[float, ...], distortion: tuple[float, ...], size: tuple[int, int]) -> PixelRays:
    """Return the rays of a lens, which are the same wherever the camera is."""
    lens = Camera(np.reshape(K, (3, 3)), np.array(distortion), size, np.eye(4))
    rays = _splined(lens, np.zeros(2))
    for each in (rays.x, rays.y):
        each.flags.writeable = False
    return rays


def _splined(camera: Camera, displaced: Array) -> PixelRays:
    width, height = camera.size
    columns, rows = _grid(width), _grid(height)
    points = camera.normalised(np.stack(np.meshgrid(columns, rows), axis=-1) - displaced)
    return PixelRays(
        *((_spline(height) @ (points[..., i] @ _spline(width).T)).astype(np.float32) for i in range(2))
    )


@lru_cache(maxsize=8)
def _spline(pixels: int) -> Array:
    """Return the matrix (pixels, n) that maps values at `_grid(pixels)`, (n,), to their cubic spline at all pixels."""
    grid = _grid(pixels)
    return frozen(CubicSpline(grid, np.eye(len(grid)))(np.arange(pixels)))


def _grid(pixels: int) -> Array:
    return np.arange(-GRID_PX, pixels + 2.0 * GRID_PX, GRID_PX)


def smooth_displacement(size: tuple[int, int], rng: np.random.Generator, sigma_px: float) -> Array:
    """Draw a displacement of every point of an image of `size`, along x and y, on the grid of `pixel_rays`.

    Its standard deviation is `sigma_px` everywhere. Points further apart than about 60 px move independently.
    """
    shape = (len(_grid(size[1])), len(_grid(size[0])), 2)
    cells, edge = CELLS, 4 * int(np.ceil(CELLS))
    padded = rng.standard_normal((shape[0] + 2 * edge, shape[1] + 2 * edge, 2))
    smooth = gaussian_filter(padded, (cells, cells, 0.0))[edge:-edge, edge:-edge]
    return np.asarray(sigma_px * 2.0 * np.sqrt(np.pi) * cells * smooth)


def subpixel_rays(rays: PixelRays, row: Indices, column: Indices) -> SubpixelRays:
    """Return the rays of the pixels (row, column), (n,) each, with derivatives from their neighbours."""
    height, width = rays.x.shape
    left, right = np.maximum(column - 1, 0), np.minimum(column + 1, width - 1)
    above, below = np.maximum(row - 1, 0), np.minimum(row + 1, height - 1)

    def at(row: Indices, column: Indices) -> Floats:
        return np.stack([rays.x[row, column], rays.y[row, column]])

    per_column = (at(row, right) - at(row, left)) / (right - left).astype(np.float32)
    per_row = (at(below, column) - at(above, column)) / (below - above).astype(np.float32)
    return SubpixelRays(at(row, column), per_column, per_row)


@dataclass(frozen=True, eq=False)
class Bundle:
    """Rays from one point in any frame: `origin` (3,) m, and directions per unit of depth as three arrays."""

    origin: Array
    dx: Floats
    dy: Floats
    dz: Floats


def bundle_in(T_frame_camera: Array, rays: PixelRays) -> Bundle:
    """Transform the rays to another frame."""
    R = T_frame_camera[:3, :3].astype(np.float32)
    return Bundle(T_frame_camera[:3, 3], *(R[i, 0] * rays.x + (R[i, 1] * rays.y + R[i, 2]) for i in range(3)))
