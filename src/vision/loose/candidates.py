"""Find places in the image where the top of a cube may be: squares of its size, even inside, with steps on their sides.

The image is rectified to the plane of the top of a cube that stands on the place's plane. For each yaw it is rotated,
and the mean step along each of the four sides is computed for all places at once (a generalised Hough transform for one
square). A cube that leans by 8 degrees or sits 8 mm lower changes its square by 1 %, which this does not notice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from vision.occupancy.edge_response import PlateView

PITCH = 0.8e-3  # m of the rectified image
YAWS = np.radians(np.arange(0.0, 90.0, 5.0))
BLUR_PX = 1.5  # standard deviation, of the photograph, against aliasing
CORNER = 5e-3  # m at each end of a side, which a wrong yaw blurs
GAP, WINDOW = 0.8e-3, 2.4e-3  # m between a side and the windows on both sides of it, and their width
MOST_STEP = 40.0  # grey levels; a larger step counts as this
INNER = 5e-3  # m from a side, where the even part of a top begins
ROUGH = 1.5  # weight of steps inside, against those on the sides
APART, TURNED = 4e-3, np.radians(12.0)  # m and rad between two candidates
MOST = 12

Floats = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Candidate:
    """A square in the plane of the view: its centre, m, its yaw, rad, and how well it shows, grey levels."""

    x: float
    y: float
    yaw: float
    score: float


def candidates(view: PlateView, size: float, within: float) -> list[Candidate]:
    """Return squares of edge `size` m within `within` m of the view's origin, best first, at most `MOST`."""
    soft = np.asarray(cv2.GaussianBlur(view.grey, (0, 0), BLUR_PX), dtype=np.float32)
    blurred = replace(view, grey=soft)
    half = round((within + 0.75 * size) / PITCH)
    axis = PITCH * np.arange(-half, half + 1)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1)
    found: list[Candidate] = []
    radius = np.hypot(grid[..., 0], grid[..., 1])
    rectified = np.stack([blurred.at(row) for row in grid]).astype(np.float32)
    for yaw in YAWS:
        c, s = np.cos(yaw), np.sin(yaw)
        grey = _rotated(rectified, grid @ np.array([[c, s], [-s, c]]) / PITCH + half)
        score = np.where(radius <= within, _scores(grey, size), -np.inf)
        peaks = np.asarray(cv2.dilate(score.astype(np.float32), np.ones((5, 5), np.uint8)) <= score)
        for row, column in np.argwhere(peaks & (score > 0.0)):
            x, y = axis[column], axis[row]
            found.append(Candidate(c * x - s * y, s * x + c * y, float(yaw), float(score[row, column])))
    found.sort(key=lambda one: (-round(one.score, 3), one.x, one.y, one.yaw))
    kept: list[Candidate] = []
    for one in found:
        if all(_differ(one, other) for other in kept):
            kept.append(one)
            if len(kept) == MOST:
                break
    return kept


def _differ(a: Candidate, b: Candidate) -> bool:
    turn = abs((a.yaw - b.yaw + np.pi / 4.0) % (np.pi / 2.0) - np.pi / 4.0)
    return bool(np.hypot(a.x - b.x, a.y - b.y) > APART or turn > TURNED)


def _rotated(grey: Floats, at: Array) -> Floats:
    """Interpolate an image at cells (h, w, 2), column first; NaN beyond it and beside its NaN."""
    column, row = at[..., 0].astype(np.float32), at[..., 1].astype(np.float32)
    turned = cv2.remap(
        grey, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan
    )
    return np.asarray(turned, dtype=np.float32)


def _scores(grey: Floats, size: float) -> Array:
    """How well a square with sides along the rows and columns shows around each place, grey levels, same shape."""
    inside = np.isfinite(grey)
    grey = np.where(inside, grey, np.float32(0.0))
    # places outside the photograph have no steps
    shown = cv2.erode(inside.astype(np.uint8), np.ones((9, 9), np.uint8)).astype(np.float32)
    across = _steps(grey) * shown
    down = _steps(grey.T).T * shown
    length = max(round((size - 2.0 * CORNER) / PITCH), 1)
    at = round(size / 2.0 / PITCH)
    on_columns = _mean(across, (1, length))
    on_rows = _mean(down, (length, 1))
    sides = [
        _shifted(on_columns, at, 1),
        _shifted(on_columns, -at, 1),
        _shifted(on_rows, at, 0),
        _shifted(on_rows, -at, 0),
    ]
    inner = max(round((size - 2.0 * INNER) / PITCH), 1)
    rough = _mean(np.maximum(across, down), (inner, inner))
    weakest = np.minimum(np.minimum(sides[0], sides[1]), np.minimum(sides[2], sides[3]))
    return np.asarray(sum(sides) / 4.0 + 0.5 * weakest - ROUGH * rough, dtype=float)


def _mean(field: Floats, size: tuple[int, int]) -> Floats:
    """Mean over so many columns and rows around each place, 0 beyond the field."""
    return np.asarray(cv2.blur(field, size, borderType=cv2.BORDER_CONSTANT), dtype=np.float32)


def _steps(grey: Floats) -> Floats:
    """Size of the step along each row, between windows on both sides of each place; at most `MOST_STEP`."""
    gap, width = round(GAP / PITCH), round(WINDOW / PITCH)
    kernel = (
        np.concatenate([-np.ones(width), np.zeros(2 * gap - 1), np.ones(width)]).astype(np.float32) / width
    )
    step = cv2.filter2D(np.ascontiguousarray(grey), cv2.CV_32F, kernel[None])
    return np.minimum(np.abs(cv2.blur(step, (1, 3))), np.float32(MOST_STEP))


def _shifted(field: Floats, by: int, axis: int) -> Floats:
    """The field at places further along an axis by so many cells; 0 beyond it."""
    moved = np.roll(field, -by, axis=axis)
    empty = slice(-by, None) if by > 0 else slice(None, -by)
    moved[(slice(None), empty) if axis == 1 else (empty, slice(None))] = 0.0
    return moved
