"""Find the sides of a board's outline in an image, near where a pose puts them: a line for each side.

A side is known by its line alone: where along it a point lies cannot be seen, and its ends are hidden or rounded. So a
line is kept as two points, and only their distances from it, across, are measurements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.se3 import Array, Bools, apply
from vision.camera.model import Camera
from vision.markers.edge_profiles import LEAST_HALF_PX, NARROW_PX, Grey, edge_offsets

SIDES = ("top", "right", "bottom", "left")
"""Names of the sides, in marker 1's picture; side k leads from corner k to the next."""
STATIONS = 96  # profiles across a side
END_GAP = 0.07  # part of a side at either end that is not used: corners are rounded, and shadows meet there
TRIED = 4  # every such station is tried as the end of a line
INLIER_M, INLIER_PX = (
    0.15e-3,
    0.5,
)  # largest distance of a point from the line that it supports; the larger one counts
LEAST_SEEN = 0.5  # part of a side's stations that must lie on its line
_ALONG = END_GAP + (1.0 - 2.0 * END_GAP) * (np.arange(STATIONS) + 0.5) / STATIONS


@dataclass(frozen=True, eq=False)
class Side:
    """A side of an outline, as found in an image.

    Attributes:
        index: 0 to 3, see `SIDES`.
        along: where its two points are on the side, (2,): 0 is its first corner, 1 the next.
        points: these points on the outline as it is in the board's file, (2, 3) m.
        inwards: unit vectors across the side at both, (2, 2).
        found_px: where the line is, (2, 2) px.
        noise: covariance of both distances across the side in this image, (2, 2) px^2.
        seen: part of the stations whose edges lie on the line.
    """

    index: int
    along: Array
    points: Array
    inwards: Array
    found_px: Array
    noise: Array
    seen: float

    @property
    def confirms(self) -> bool:
        """Whether enough of it shows."""
        return self.seen >= LEAST_SEEN


def find_sides(image: Grey, board: Board, T_camera_board: Array, camera: Camera, reach: float) -> list[Side]:
    """Find the sides of a board that has an outline.

    Args:
        image: (h, w).
        board: with its outline.
        T_camera_board: a pose that puts the sides within `reach` of where they are.
        camera: the camera; its extrinsics are not used.
        reach: distance on the board within which a side is looked for, m.

    Returns:
        The sides with a line, however little of them shows.
    """
    if board.outline is None:
        return []
    corners = np.column_stack([board.outline.corners, np.zeros(4)])
    sides = [
        _side(index, a, b, image, T_camera_board, camera, reach)
        for index, (a, b) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True))
    ]
    return [side for side in sides if side is not None]


def meet(sides: Sequence[Side]) -> bool:
    """Whether at least two of the sides are not opposite: opposite ones alone leave the board free to slide."""
    return len({side.index % 2 for side in sides}) == 2


def _side(index: int, a: Array, b: Array, image: Grey, T: Array, camera: Camera, reach: float) -> Side | None:
    direction = (b - a) / np.linalg.norm(b - a)
    inward = np.array([direction[1], -direction[0], 0.0])  # corners go clockwise
    points = a + _ALONG[:, None] * (b - a)
    px, deeper = (camera.project(apply(T, p)) for p in (points, points + 1e-3 * inward))
    px_per_m = 1e3 * np.linalg.norm(deeper - px, axis=-1)
    if not (np.isfinite(px).all() and np.isfinite(px_per_m).all() and (px_per_m > 0.0).all()):
        return None
    # across the side in the image, which perspective makes no right angle to `deeper - px`
    tangent = np.gradient(px, axis=0)
    across = np.stack([-tangent[:, 1], tangent[:, 0]], axis=-1)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    across *= np.sign(((deeper - px) * across).sum(axis=-1))[:, None]
    scale = float(px_per_m.mean())
    tolerance = max(INLIER_PX, INLIER_M * scale)
    calibrated = _in_region(px, camera)
    line, on = np.zeros(2), np.zeros(STATIONS, dtype=bool)
    for half in (reach * scale, NARROW_PX):
        predicted = line[0] + line[1] * _ALONG
        start = px + predicted[:, None] * across
        edges = edge_offsets(image, start, across, np.full(STATIONS, max(half, LEAST_HALF_PX)))
        offset = predicted + edges.offset
        line, on = _line(offset, edges.good & calibrated, tolerance)
        if np.count_nonzero(on) < STATIONS // 8:
            return None
    A = np.stack([np.ones(STATIONS), _ALONG], axis=-1)
    ends = np.flatnonzero(on)[[0, -1]]
    left = (offset - A @ line)[on]
    spread = np.linalg.inv(A[on].T @ A[on]) * float(left @ left) / max(len(left) - 2, 1)
    found = px[ends] + (A[ends] @ line)[:, None] * across[ends]
    noise = A[ends] @ spread @ A[ends].T
    return Side(index, _ALONG[ends], points[ends], across[ends], found, noise, float(on.mean()))


def _in_region(px: Array, camera: Camera) -> Bools:
    """Whether points (n, 2) px are where the lens was calibrated."""
    if camera.region is None:
        return np.ones(len(px), dtype=bool)
    left, top, right, bottom = camera.region
    return np.asarray(((px >= (left, top)) & (px <= (right, bottom))).all(axis=-1))


def _line(offset: Array, good: Bools, tolerance: float) -> tuple[Array, Bools]:
    """Fit offset = line[0] + line[1] * along to the stations that most agree, whatever the others show.

    Returns:
        The line (2,), and which stations lie on it within the tolerance.
    """
    tried = np.flatnonzero(good)[::TRIED]
    i, j = (tried[k] for k in np.triu_indices(len(tried), 1))
    if not len(i):
        return np.zeros(2), np.zeros(STATIONS, dtype=bool)
    slopes = (offset[j] - offset[i]) / (_ALONG[j] - _ALONG[i])
    starts = offset[i] - slopes * _ALONG[i]
    near = good & (np.abs(offset - starts[:, None] - slopes[:, None] * _ALONG) < tolerance)
    on = near[int(np.argmax(near.sum(axis=1)))]
    line = np.zeros(2)
    for _ in range(3):
        line[1], line[0] = _fitted(_ALONG[on], offset[on])
        again = good & (np.abs(offset - line[0] - line[1] * _ALONG) < tolerance)
        if np.count_nonzero(again) < 3 or np.array_equal(again, on):
            break
        on = again
    return line, on


def _fitted(along: Array, offset: Array) -> tuple[float, float]:
    """Slope and start of the least-squares line."""
    middle, mean = along.mean(), offset.mean()
    spread = float(((along - middle) ** 2).sum())
    slope = float(((along - middle) * (offset - mean)).sum()) / spread if spread > 0.0 else 0.0
    return slope, float(mean - slope * middle)
