"""Blur of straight edges between dark and light: the standard deviation of their grey gradient, px.

Profiles across an edge are averaged along it, so that noise averages out. Each of the two edge directions of a pattern
has its own blur, because motion blurs only the edges across it.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from arm.se3 import Array
from vision.camera.frame_source import Image, as_grey
from vision.markers.detect import Marker, shortest_side
from vision.markers.dictionaries import predefined

LINES = 24  # profiles across an edge, averaged
MARGIN_PX = 3.0  # between the end of a profile and the next edge, whose blur it must exclude
MOST_REACH_PX, LEAST_REACH_PX = 10.0, 2.0
STEP_PX = 0.25
LEAST_SIDE_PX = (
    7.0  # of a module; profiles across the borders of smaller markers are too short to tell a blur of 2 px
)
SHARP_PX = 1.5  # a lens in focus has 0.5 to 1; the calibration of the camera refuses more, too


def marker_blur(image: Image, markers: Sequence[Marker], dictionary: str) -> float | None:
    """Return the blur of the outer borders of markers in the blurrier edge direction, px; None without markers
    that are large enough.

    Args:
        image: grey (h, w) or BGR (h, w, 3).
        markers: detected in it; around each is a white border of one module.
        dictionary: of the markers, OpenCV's name.
    """
    grey, room = as_grey(image), 1.0 / (predefined(dictionary).markerSize + 2)
    large = [m.corners_px for m in markers if room * shortest_side(m.corners_px) >= LEAST_SIDE_PX]
    if not large:
        return None
    corners = np.stack(large)
    blur = [
        float(np.median(blur_widths(*mean_profiles(grey, *_sides(corners, first), room)))) for first in (0, 1)
    ]
    return max(blur)


def _sides(corners: Array, first: int) -> tuple[Array, Array]:
    """Both ends of two opposite sides of markers (n, 4, 2), each (2 n, 2)."""
    ends = np.roll(corners, -1, axis=1)
    return corners[:, first::2].reshape(-1, 2), ends[:, first::2].reshape(-1, 2)


def mean_profiles(grey: Image, starts: Array, ends: Array, room: float) -> tuple[Array, Array]:
    """Return the mean grey profile across each edge, (edges, samples), and its half length in px, (edges,).

    Args:
        grey: (h, w).
        starts, ends: of the edges, (edges, 2) px.
        room: distance to the next edge on either side, relative to the edge's length.
    """
    along = ends - starts
    length = np.linalg.norm(along, axis=-1)
    half = np.clip(room * length - MARGIN_PX, LEAST_REACH_PX, MOST_REACH_PX)
    across = np.stack([along[:, 1], -along[:, 0]], axis=-1) / length[:, None]
    share = 0.25 + 0.5 * (np.arange(LINES) + 0.5) / LINES
    centres = starts[:, None] + share[:, None] * along[:, None]
    count = int(np.ceil(2.0 * half.max() / STEP_PX)) + 1
    s = half[:, None] * np.linspace(-1.0, 1.0, count)
    points = centres[:, :, None] + s[:, None, :, None] * across[:, None, None]
    flat = points.reshape(-1, LINES * count, 2).astype(np.float32)
    values = cv2.remap(grey.astype(np.float32), flat[..., 0], flat[..., 1], cv2.INTER_LINEAR)
    return np.asarray(values.reshape(len(starts), LINES, count).mean(axis=1), dtype=float), half


def blur_widths(profile: Array, half: Array) -> Array:
    """Return the standard deviation of the gradient across each edge, px; signed, so that noise averages out.

    `profile` and `half` are of `mean_profiles`.
    """
    gradient = np.diff(profile, axis=1)
    gradient *= np.sign(gradient.sum(axis=1))[:, None]
    s = half[:, None] * np.linspace(-1.0, 1.0, profile.shape[1])
    middle = 0.5 * (s[:, 1:] + s[:, :-1])
    total = np.maximum(gradient.sum(axis=1), 1e-9)
    mean = (gradient * middle).sum(axis=1) / total
    variance = (gradient * (middle - mean[:, None]) ** 2).sum(axis=1) / total
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
