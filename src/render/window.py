"""The part of an image that a solid can cover, so that only its rays are tested."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.se3 import Array, Indices, apply, inverse
from render.rays import Floats, PixelRays

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


@dataclass(frozen=True, eq=False)
class Cells:
    """An image's rays, sampled: where the rays of each grid cell are on the plane z = 1.

    Attributes:
        rows, columns: pixels of the grid's lines.
        low, high: bounds of the cells' rays along x and along y, (2, rows - 1, columns - 1).
        slack: a quarter of a cell, for the curved sides of cells and the neighbours of edge pixels, same shape.
    """

    rows: Indices
    columns: Indices
    low: Floats
    high: Floats
    slack: Floats


def cells_of(rays: PixelRays) -> Cells:
    """Sample the rays of an image."""
    rows, columns = (np.unique(np.append(np.arange(0, n, STEP_PX), n - 1)) for n in rays.x.shape)
    at = np.stack([f[np.ix_(rows, columns)] for f in (rays.x, rays.y)])
    corners = np.stack([at[:, :-1, :-1], at[:, 1:, :-1], at[:, :-1, 1:], at[:, 1:, 1:]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return Cells(rows, columns, low, high, 0.25 * (high - low))


def window_of(T_base_solid: Array, half_extent: Array, T_base_camera: Array, cells: Cells) -> Window | None:
    """Return the window of all pixels (and their neighbours) whose rays can hit a box; None if there are none.

    The plane z = 1 is used, where edges are straight despite the distortion.

    Args:
        T_base_solid: pose of the box's centre, 4x4.
        half_extent: its half edges, (3,) m.
        T_base_camera: pose of the camera, 4x4.
        cells: of the camera's rays.
    """
    points = _visible_corners(inverse(T_base_camera) @ T_base_solid, half_extent)
    if not len(points):
        return None
    on_plane = points[:, :2] / points[:, 2:]
    low, high = (f[:, None, None] for f in (on_plane.min(axis=0), on_plane.max(axis=0)))
    # a cell may be hit unless its corners are all on one side of the rectangle
    inside = ((cells.high >= low - cells.slack) & (cells.low <= high + cells.slack)).all(axis=0)
    if not inside.any():
        return None
    rows, columns = cells.rows, cells.columns
    hit_rows, hit_columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    return Window(
        int(rows[hit_rows[0]]),
        int(rows[hit_rows[-1] + 1]) + 1,
        int(columns[hit_columns[0]]),
        int(columns[hit_columns[-1] + 1]) + 1,
    )


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
