"""Measure the corners of a marker as intersections of its four border lines (docs/sources.md, "Corners in images").

Grey profiles are sampled across each side of the black square; a robust centroid of the gradient is the edge point. A
robust line fit through the undistorted edge points follows. It is unbiased, whereas cornerSubPix is biased by 0.15 px
inward at such outer corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.se3 import Array, Bools, cross
from vision.camera.frame_source import Image
from vision.camera.model import Camera
from vision.markers.edge_profiles import LEAST_HALF_PX, NARROW_PX, WIDE_PX, Grey, edge_offsets

ROWS = 64  # profiles across a side
END_GAP_PX, END_GAP = 4.0, 0.06  # distance of the profiles from the corners, px and relative to the side
BY_TURN = 3.0 / (1.0 - 2.0 * END_GAP) ** 2
"""Variance of a line at its ends due to its turn, over that at its middle: its points lie within END_GAP of them."""
LEAST_INLIERS = 0.6  # fraction of a side's profiles that must agree on its line
INLIER_PX = 1.0  # largest distance of an inlier from its line
PROFILE_PART = 0.45  # half length of a profile in modules: it stays inside the black border and the white one
LEAST_MODULE_PX = LEAST_HALF_PX / 0.8  # smallest module with border lines: profiles end before the code
MOST_MOVED_PX = 4.0  # largest distance from the rough corner: beyond is another edge, as of a finger
_ROBUST_ROUNDS = 6


@dataclass(frozen=True)
class BorderCorners:
    """Corners of markers.

    Attributes:
        corners_px: (m, 4, 2) px.
        good: which markers (m,) have four good lines; corners of the others are meaningless.
        side_noise_px: standard deviation of each side's line at its middle in this image alone, (m, 4) px, from the
            scatter of the edge points about it. It does not contain what shifts or turns a whole side in all images.
    """

    corners_px: Array
    good: Bools
    side_noise_px: Array


def refine_by_border_lines(grey: Image, rough_px: Array, camera: Camera, modules: int) -> BorderCorners:
    """Refine the corners of markers by their border lines.

    Args:
        grey: image (h, w).
        rough_px: corners (m, 4, 2) px to within about three pixels, in the order of the marker's outline.
        camera: for its distortion.
        modules: cells across the black square (6 for a 4x4 dictionary); they limit the length of a profile.
    """
    image = grey.astype(np.float32)
    sides = np.linalg.norm(np.roll(rough_px, -1, axis=1) - rough_px, axis=-1)
    fits = sides.min(axis=1) >= LEAST_MODULE_PX * modules
    reach = np.maximum(PROFILE_PART * sides.min(axis=1) / modules, LEAST_HALF_PX)
    corners, good, sigma = rough_px, fits, np.zeros(rough_px.shape[:2])
    for half in (WIDE_PX, NARROW_PX):
        edges = _edge_points(image, corners, np.minimum(reach, half))
        normals, offsets, inliers, sigma = _fit_lines(*edges, camera)
        corners_on_plane = _intersections(normals, offsets) @ np.linalg.inv(camera.K[:2, :2]).T
        crossings = camera.project(np.insert(corners_on_plane, 2, 1.0, axis=-1))
        good = fits & (inliers >= LEAST_INLIERS).all(axis=1) & np.isfinite(crossings).all(axis=(1, 2))
        corners = np.where(good[:, None, None], crossings, rough_px)
    near = np.abs(corners - rough_px).max(axis=(1, 2)) < MOST_MOVED_PX
    return BorderCorners(corners, good & near, sigma)


def _edge_points(image: Grey, corners: Array, half: Array) -> tuple[Array, Array]:
    """Edge points (m, 4, ROWS, 2) px and their weights (m, 4, ROWS), 0 where there is no edge."""
    start, end = corners[:, :, None], np.roll(corners, -1, axis=1)[:, :, None]
    length = np.linalg.norm(end - start, axis=-1, keepdims=True)
    gap = np.maximum(END_GAP, np.minimum(END_GAP_PX / length, 0.3))
    along = gap + (1.0 - 2.0 * gap) * (np.arange(ROWS)[:, None] + 0.5) / ROWS
    centres = start + along * (end - start)
    direction = (end - start) / length
    outward = np.stack([direction[..., 1], -direction[..., 0]], axis=-1)  # corners go clockwise in the image
    outward = np.broadcast_to(outward, centres.shape)
    edges = edge_offsets(image, centres, outward, np.broadcast_to(half[:, None, None], centres.shape[:-1]))
    return centres + edges.offset[..., None] * outward, edges.good.astype(float)


def _fit_lines(edges_px: Array, edge_weights: Array, camera: Camera) -> tuple[Array, Array, Array, Array]:
    """Fit lines normal @ x = offset in undistorted pixels.

    Returns:
        Normals (m, 4, 2), offsets (m, 4), fractions of inliers (m, 4), and standard deviations of the lines at their
        middles (m, 4) px.
    """
    points = camera.normalised(edges_px) @ camera.K[:2, :2].T  # undistorted px from the centre
    weights = edge_weights
    normals = offsets = distance = sigma = np.empty(0)
    for _ in range(_ROBUST_ROUNDS):
        total = np.maximum(weights.sum(axis=-1), 1e-9)
        mean = (weights[..., None] * points).sum(axis=-2) / total[..., None]
        centred = points - mean[..., None, :]
        scatter = np.einsum("...n,...ni,...nj->...ij", weights, centred, centred)
        normals = np.linalg.eigh(scatter)[1][..., 0]
        offsets = (normals * mean).sum(axis=-1)
        distance = (centred * normals[..., None, :]).sum(axis=-1)
        spread = 1.4826 * np.median(np.abs(distance), axis=-1, keepdims=True)
        sigma = _sigma_at_middle(weights, distance)
        limit = np.clip(4.0 * spread, 0.1, INLIER_PX)
        weights = edge_weights * np.clip(1.0 - (distance / limit) ** 2, 0.0, None) ** 2  # Tukey's biweight
    agree = (edge_weights > 0.0) & (np.abs(distance) < INLIER_PX)
    return normals, offsets, agree.mean(axis=-1), sigma


def _sigma_at_middle(weights: Array, distance: Array) -> Array:
    """Standard deviation (m, 4) px of lines at their middles, if each edge point has its own error.

    Args:
        weights: of edge points, (m, 4, ROWS).
        distance: of edge points from their line, (m, 4, ROWS) px.
    """
    total = np.maximum(weights.sum(axis=-1), 1e-9)
    variance = (weights * distance**2).sum(axis=-1) / total
    return np.asarray(np.sqrt(variance / total))


def _intersections(normals: Array, offsets: Array) -> Array:
    """Corners (m, 4, 2) in undistorted pixels: corner k is the intersection of the lines of sides k - 1 and k."""
    homogeneous = np.concatenate([normals, -offsets[..., None]], axis=-1)
    at = cross(np.roll(homogeneous, 1, axis=1), homogeneous)
    return np.asarray(at[..., :2] / np.where(np.abs(at[..., 2:]) > 1e-3, at[..., 2:], np.nan))
