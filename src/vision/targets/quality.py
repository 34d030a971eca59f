"""Quality of a calibration target's image: sharpness, contrast, exposure, and the size of its markers.

Sharpness is the standard deviation of the blur, px, from grey profiles across the edges of the chessboard. Each of the
two edge directions has its own value, because motion blurs only the edges across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from arm.se3 import Array, Indices, frozen
from vision.camera.frame_source import Image, as_grey
from vision.camera.model import Camera
from vision.markers.dictionaries import predefined
from vision.markers.edge_blur import blur_widths, mean_profiles
from vision.markers.edge_lines import refine_by_border_lines
from vision.targets.target import Target, TargetView

SATURATED, BLACK = 254, 1


@dataclass(frozen=True, eq=False)
class Quality:
    """Quality of a target's image.

    Attributes:
        blur_px: standard deviation of the blur in the blurrier edge direction, px; NaN without whole edges.
        contrast: grey levels between white and black squares, median over the edges.
        saturated: fraction of saturated samples in white squares, 0 to 1.
        marker_share: apparent edge of the markers in squares; NaN without markers.
    """

    blur_px: float
    contrast: float
    saturated: float
    marker_share: float


def measure_quality(image: Image, target: Target, view: TargetView) -> Quality:
    """Measure the quality of an image, grey (h, w) or BGR, in which `view` of the target was detected."""
    grey = as_grey(image)
    blur: list[float] = []
    steps: list[float] = []
    white: list[Array] = []
    # to the next edge, squares
    room = (1.0 - target.marker / target.square) / 2.0 if target.marker > 0.0 else 0.5
    for starts, ends in _edges(target, view):
        if not len(starts):
            continue
        profile, half = mean_profiles(grey, starts, ends, room)
        low, high = profile[:, :3].mean(axis=1), profile[:, -3:].mean(axis=1)
        steps += list(np.abs(high - low))
        white.append(np.maximum(profile[:, :3], profile[:, -3:]).ravel())
        blur.append(float(np.median(blur_widths(profile, half))))
    return Quality(
        max(blur) if blur else float("nan"),
        float(np.median(steps)) if steps else 0.0,
        float(np.mean(np.concatenate(white) >= SATURATED)) if white else 0.0,
        _marker_share(grey, target, view),
    )


def _grid(target: Target, view: TargetView) -> Indices:
    """Index of each inner corner in the view's lists, (rows - 1, columns - 1); -1 if not detected."""
    where = np.full(target.corners, -1, dtype=np.intp)
    where[view.ids] = np.arange(len(view.ids))
    return where.reshape(target.rows - 1, target.columns - 1)


def _edges(target: Target, view: TargetView) -> list[tuple[Array, Array]]:
    """Both ends of the edges along the rows, and along the columns, if both corners were detected."""
    grid = _grid(target, view)
    found = []
    for a, b in ((grid[:, :-1], grid[:, 1:]), (grid[:-1], grid[1:])):
        both = (a >= 0) & (b >= 0)
        found.append((view.corners_px[a[both]], view.corners_px[b[both]]))
    return found


def _marker_share(grey: Image, target: Target, view: TargetView) -> float:
    """Edge of the markers in units of the square around each, which is small enough to ignore distortion."""
    if not len(view.marker_ids):
        return float("nan")
    height, width = grey.shape
    f = 3.0 * width
    K = np.array([[f, 0.0, width / 2.0], [0.0, f, height / 2.0], [0.0, 0.0, 1.0]])
    # sides are too short for distortion
    straight = Camera(K, np.zeros(5), (width, height), frozen(np.eye(4)))
    modules = predefined(target.dictionary).markerSize + 2
    lines = refine_by_border_lines(grey, view.outlines_px, straight, modules)
    if not lines.good.any():
        return float("nan")
    sides = []
    for marker, square in _whole_squares(target, view):
        if lines.good[marker]:
            outline = _in_square(lines.corners_px[marker], square)
            sides.append(np.linalg.norm(np.roll(outline, -1, axis=0) - outline, axis=1).mean())
    return float(np.median(sides)) if sides else float("nan")


def _whole_squares(target: Target, view: TargetView) -> list[tuple[int, Array]]:
    """Markers of a view, by index, with all corners of their square detected, and these corners, (4, 2) px."""
    grid = np.pad(_grid(target, view), 1, constant_values=-1)
    squares = target.marker_squares()
    found = []
    for place, marker in enumerate(view.marker_ids):
        if marker >= len(squares):
            continue
        i, j = squares[marker]
        corners = grid[[j, j, j + 1, j + 1], [i, i + 1, i + 1, i]]
        if (corners >= 0).all():
            found.append((place, view.corners_px[corners]))
    return found


def _in_square(pixels: Array, square: Array) -> Array:
    """Pixels (n, 2) in units of the square (4, 2) px around them."""
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    H = cv2.getPerspectiveTransform(square.astype(np.float32), unit)
    return np.asarray(cv2.perspectiveTransform(pixels.reshape(-1, 1, 2).astype(float), H).reshape(-1, 2))
