"""The part of an image that a solid can cover, so that only its rays are tested."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.se3 import Array, apply, inverse
from render.rays import PixelRays

NEAREST = 0.02  # m in front of the camera; nearer parts are invisible
STEP_PX = 16  # pitch at which the image's rays are sampled


@dataclass(frozen=True)
class Window:
    """Rows and columns of an image, ends excluded."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def area(self) -> tuple[slice, slice]:
        """The window as an index into an image."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def cut(self, rays: PixelRays) -> PixelRays:
        """Return the rays of the window's pixels."""
        return PixelRays(rays.x[self.area], rays.y[self.area])


def window_of(
    T_base_solid: Array, half_extent: Array, T_base_camera: Array, rays: PixelRays
) -> Window | None:
    """Return the window of all pixels (and their neighbours) whose rays can hit a box; None if there are none.

    The plane z = 1 is used, where edges are straight despite the distortion.

    Args:
        T_base_solid: pose of the box's centre, 4x4.
        half_extent: its half edges, (3,) m.
        T_base_camera: pose of the camera, 4x4.
        rays: of the camera's pixels.
    """
    points = _visible_corners(inverse(T_base_camera) @ T_base_solid, half_extent)
    if not len(points):
        return None
    low, high = (points[:, :2] / points[:, 2:]).min(axis=0), (points[:, :2] / points[:, 2:]).max(axis=0)
    height, width = rays.x.shape
    rows, columns = (np.unique(np.append(np.arange(0, n, STEP_PX), n - 1)) for n in (height, width))
    x, y = (f[np.ix_(rows, columns)] for f in (rays.x, rays.y))
    # a grid cell may be hit unless its corners are all on one side of the rectangle
    inside = np.ones((len(rows) - 1, len(columns) - 1), dtype=bool)
    for values, least, most in ((x, low[0], high[0]), (y, low[1], high[1])):
        cells = np.stack([values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]])
        inside &= (cells.max(axis=0) >= least - _slack(cells)) & (cells.min(axis=0) <= most + _slack(cells))
    if not inside.any():
        return None
    hit_rows, hit_columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    return Window(
        int(rows[hit_rows[0]]),
        int(rows[hit_rows[-1] + 1]) + 1,
        int(columns[hit_columns[0]]),
        int(columns[hit_columns[-1] + 1]) + 1,
    )


def _slack(cells: Array) -> Array:
    """Return a quarter of a cell, which allows for the curved sides of cells and the neighbours of edge pixels."""
    return np.asarray(0.25 * (cells.max(axis=0) - cells.min(axis=0)))


def _visible_corners(T_camera_solid: Array, half: Array) -> Array:
    """Return the corners (n, 3) m of the part of a box in front of the camera, in the camera frame."""
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = apply(T_camera_solid, signs * half)
    points = list(corners[corners[:, 2] >= NEAREST])
    for a in range(8):
        for b in range(a + 1, 8):
            (za, zb), edge = corners[[a, b], 2], int(np.abs(signs[a] - signs[b]).sum()) == 2
            if edge and (za - NEAREST) * (zb - NEAREST) < 0.0:
                points.append(corners[a] + (NEAREST - za) / (zb - za) * (corners[b] - corners[a]))
    return np.array(points).reshape(-1, 3)
