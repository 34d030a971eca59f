"""Explain corners that fit no pose of a board: markers swapped, turned or elsewhere, or another focal length."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from arm.board import Board
from arm.se3 import Array, moved
from vision.boards.pose_fit import Corners, fit_weighted, planar_poses
from vision.camera.model import Camera
from vision.camera.projection import Projection

_STEPS = 12
_SQUARE = 0.01  # relative; the pixels of nearly all cameras are square to this
_CLEAR = 3.0  # times that corners fit better by another focal length if it is told


def arrangement(board: Board, corners: Corners, camera: Camera, limit_px: float) -> str | None:
    """Describe the arrangement that explains the corners to `limit_px` (rms), for a person; None if there is none."""
    pixels = corners.median()
    for words, order in _orders(board):
        start = planar_poses(pixels[order], corners.points, camera)[0]
        fit = fit_weighted(Corners(pixels[order][None], corners.points), np.ones((1, 8)), start, camera)
        if _rms(fit.mean_residual_px) < limit_px:
            return words
    second = _second_marker(pixels, corners.points, camera, limit_px)
    if second is None:
        return None
    low, high = board.marker_ids
    x, y = np.rint(1e3 * second) + 0.0  # no -0
    expected = 1e3 * board.marker_corners()[1].mean(axis=0)
    return (
        f"marker {high} is at {x:.0f}, {y:.0f} mm from marker {low}, not {expected[0]:g}, {expected[1]:g} mm: it "
        "belongs to another board, or was glued elsewhere"
    )


def other_focal(corners: Corners, camera: Camera, residual_px: float, limit_px: float) -> str | None:
    """Describe the focal length that explains the corners to a third of `limit_px` and of their residual (rms); None if
    there is none among those that are often mistaken: of images of half or twice the size, or one of fx and fy."""
    fx, fy = camera.K.diagonal()[:2].tolist()
    pixels = corners.median()
    best, words = min(residual_px, limit_px) / _CLEAR, None
    for x, y in ((fy, fy), (fx, fx), (fx / 2.0, fy / 2.0), (2.0 * fx, 2.0 * fy)):
        if x == y and abs(fx / fy - 1.0) < _SQUARE:
            continue
        K = camera.K.copy()
        K[0, 0], K[1, 1] = x, y
        other = replace(camera, K=K)
        start = planar_poses(pixels, corners.points, other)[0]
        fit = fit_weighted(Corners(pixels[None], corners.points), np.ones((1, 8)), start, other)
        if (rms := _rms(fit.mean_residual_px)) < best:
            best = rms
            words = (
                f"with fx {x:.0f} and fy {y:.0f} px they fit to {rms:.2f} px, and K_px of the camera file has "
                f"{fx:.0f} and {fy:.0f}: is it that of these images?"
            )
    return words


def _orders(board: Board) -> Iterator[tuple[str, list[int]]]:
    """Yield other assignments of the eight corners to the markers: a description, and the order of the corners."""
    low, high = board.marker_ids
    first, second = [0, 1, 2, 3], [4, 5, 6, 7]
    yield f"markers {low} and {high} are swapped", [*second, *first]
    for quarters in (1, 2, 3):
        turned = [(i + quarters) % 4 for i in range(4)]
        yield f"marker {low} is rotated by {90 * quarters} deg", [*turned, *second]
        yield f"marker {high} is rotated by {90 * quarters} deg", [*first, *(4 + i for i in turned)]


def _second_marker(pixels: Array, points: Array, camera: Camera, limit_px: float) -> Array | None:
    """Position of the second marker on the plate, (2,) m from the first, if that explains all corners."""
    shifted = points.copy()
    T = planar_poses(pixels[:4], points[:4], camera)[0]
    second = np.arange(8) >= 4
    for _ in range(_STEPS):
        seen = Projection(camera, T, shifted)
        by_shift = seen.by_point[..., :2] * second[:, None, None]
        J = np.concatenate([seen.by_target, by_shift], axis=-1).reshape(-1, 8)
        residual = pixels - seen.pixels
        if not np.isfinite(residual).all():
            return None
        step, *_ = np.linalg.lstsq(J, residual.reshape(-1), rcond=None)
        T = moved(T, step[:6])
        shifted[second, :2] += step[6:]
    if not _rms(pixels - Projection(camera, T, shifted).pixels) < limit_px:  # NaN behind the camera
        return None
    return np.asarray((shifted[4:].mean(axis=0) - shifted[:4].mean(axis=0))[:2])


def _rms(residual: Array) -> float:
    return float(np.sqrt(np.mean(residual**2)))
