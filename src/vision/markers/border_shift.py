"""Shift of a marker's borders by light, blur and print, measured at the inner edges of its black frame.

Overexposure, a gamma curve and spreading ink move every edge between black and white towards the same colour. The black
square then looks smaller or larger, and a pose fit takes that for a change of distance: 1 px on a marker of 36 mm is
0.5 mm of its size. The frame around the code is one cell wide. Its two edges shift in opposite directions, so its width
gives the shift, and its centre line does not move.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from arm.se3 import Array, Indices
from vision.camera.model import Camera
from vision.markers.edge_profiles import NARROW_PX, WIDE_PX, Grey, edge_offsets

PER_CELL = 6  # profiles across the inner edge of a white cell
CELL_PART = 0.6  # used fraction of a cell's side; its neighbours disturb the rest
INEXACT = 0.03  # fraction of a corrected shift that remains: blur beyond the ends of a profile
UNLIKE = 0.7  # fraction of a side's own shift that remains: its outer and inner edge may be lit differently
FEWEST_PROFILES = 6  # of a side; with fewer, the shift of the other sides is used
_UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class BorderShift:
    """Outward shift of the border on each side of one marker, (4,) px, and its standard deviation.

    Attributes:
        shift_px: to be subtracted; shrunk towards zero or the mean of the sides, as far as noise explains it.
        sigma_px: standard deviation of the remaining shift, which all images share; noise is not included.
        noise: covariance of `shift_px` from image to image, (4, 4) px^2.
        known: whether the code has enough white cells along its frame to measure the shift.
    """

    shift_px: Array
    sigma_px: Array
    noise: Array
    known: bool


def border_shift(
    image: Grey, corners: Array, bits: npt.NDArray[np.uint8], reach: float, camera: Camera
) -> BorderShift:
    """Measure the shift of a marker's borders.

    Args:
        image: (h, w).
        corners: apparent corners of the black square, (4, 2) px.
        bits: of its code (n, n), 1 is white, first row at the first side.
        reach: half length of a profile that stays within the frame and a cell, px.
        camera: for its distortion.
    """
    cells = len(bits) + 2
    frame = 1.0 / cells  # width in sides
    # white cells in the order of the sides
    white = np.stack([bits[0], bits[:, -1], bits[-1, ::-1], bits[::-1, 0]]).astype(bool)
    side, cell = np.nonzero(white)
    if not len(side):
        return _UNKNOWN
    within = (1.0 - CELL_PART) / 2.0 + CELL_PART * (np.arange(PER_CELL) + 0.5) / PER_CELL
    along = ((1.0 + cell[:, None] + within) * frame).ravel()
    sides = np.repeat(side, PER_CELL)
    places = np.concatenate([_on_side(sides, along, depth) for depth in (frame, frame + 0.01)])
    at, deeper = np.split(_in_image(places, corners, camera), 2)
    inward = deeper - at
    inward /= np.linalg.norm(inward, axis=-1, keepdims=True)
    offset, good = np.zeros(len(at)), np.ones(len(at), dtype=bool)
    for half in (WIDE_PX, NARROW_PX):
        found = edge_offsets(image, at + offset[:, None] * inward, inward, np.full(len(at), min(reach, half)))
        offset, good = offset + found.offset, good & found.good
    outward = -offset
    middle, variance, noise = np.full(4, np.nan), np.full(4, np.nan), np.zeros(4)
    for k in range(4):
        values = outward[good & (sides == k)]
        if len(values) >= FEWEST_PROFILES:
            middle[k] = np.median(values)
            spread = 1.4826 * np.median(np.abs(values - middle[k]))
            kept = values[np.abs(values - middle[k]) <= 3.0 * spread + 1e-6]
            middle[k] = kept.mean()
            variance[k] = 1.5 * (spread**2 + 1e-6) / len(kept)
            noise[k] = np.var(kept, ddof=1) / len(kept)
    return _shrunk(middle, variance, noise, frame)


def _shrunk(inner: Array, variance: Array, noise: Array, frame: float) -> BorderShift:
    """Outer shift from the apparent position of the inner edges relative to the shifted outer square."""
    measured = np.isfinite(inner)
    if not measured.any():
        return _UNKNOWN
    # an outer edge shifted outwards by s shifts the inner one by -s, and the outer square that predicts the inner edge
    # is too large by (1 - 2 frame) s there
    gain = -1.0 / (2.0 - 2.0 * frame)
    shift, variance = gain * inner, gain**2 * variance
    weight = np.where(measured, 1.0 / np.where(measured, variance, 1.0), 0.0)
    mean = float((weight * np.where(measured, shift, 0.0)).sum() / weight.sum())
    mean_variance = 1.0 / float(weight.sum())
    apart = np.where(measured, shift - mean, 0.0)
    excess = max(float((weight * apart**2).sum()) - (int(measured.sum()) - 1), 0.0) / float(weight.sum())
    own = np.where(measured, excess / (excess + np.where(measured, variance, 1.0)), 0.0)
    kept = max(0.0, 1.0 - 4.0 * mean_variance / mean**2) if mean else 0.0
    left = np.where(measured, (UNLIKE * own * apart) ** 2, excess) + (INEXACT * kept * mean) ** 2
    by_side = kept * weight / weight.sum() + np.diag(own) @ (np.eye(4) - weight / weight.sum())
    again = gain**2 * by_side * noise @ by_side.T
    return BorderShift(kept * mean + own * apart, np.sqrt(left), again, True)


_UNKNOWN = BorderShift(np.zeros(4), np.zeros(4), np.zeros((4, 4)), False)


def moved_outwards(corners: Array, shift_px: Array) -> Array:
    """Move the sides of a square with corners (4, 2) px outwards by (4,) px."""
    along = np.roll(corners, -1, axis=0) - corners
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    outward = np.stack([along[:, 1], -along[:, 0]], axis=-1)  # corners go clockwise in the image
    A = np.stack([np.roll(outward, 1, axis=0), outward], axis=1)  # corner k lies on sides k - 1 and k
    by = np.stack([np.roll(shift_px, 1), shift_px], axis=-1)
    return np.asarray(corners + np.linalg.solve(A, by[..., None])[..., 0])


def _on_side(sides: Indices, along: Array, depth: float) -> Array:
    """Points (n, 2) on the unit square, `depth` inside a side."""
    start, end = _UNIT[sides], _UNIT[(sides + 1) % 4]
    inward = _UNIT[(sides + 2) % 4] - end
    return np.asarray(start + along[:, None] * (end - start) + depth * inward)


def _in_image(places: Array, corners: Array, camera: Camera) -> Array:
    """Pixels (n, 2) of points on the unit square whose corners appear at (4, 2) px."""
    H = cv2.getPerspectiveTransform(_UNIT, camera.normalised(corners).astype(np.float32))
    rays = np.concatenate([places, np.ones((len(places), 1))], axis=-1) @ H.T
    return camera.project(rays / rays[:, 2:])
