"""Explain corners that fit no pose of a board: markers swapped, one rotated when glued, or one of another board."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arm.board import Board
from arm.se3 import Array, rotation, transform
from vision.boards.pose_fit import Corners, fit_weighted, planar_poses, pose_jacobian
from vision.camera.model import Camera

_STEPS = 12


def arrangement(board: Board, corners: Corners, camera: Camera, limit_px: float) -> str | None:
    """Describe the arrangement found, for a person; None if none explains the corners to within `limit_px` (rms)."""
    seen = corners.median()
    for words, order in _orders(board):
        start = planar_poses(seen[order], corners.points, camera)[0]
        fit = fit_weighted(Corners(seen[order][None], corners.points), np.ones((1, 8)), start, camera)
        if _rms(fit.mean_residual_px) < limit_px:
            return words
    place = _second_place(seen, corners.points, camera, limit_px)
    if place is None:
        return None
    low, high = board.marker_ids
    x, y = 1e3 * place
    expected = 1e3 * board.marker_corners()[1].mean(axis=0)
    return (
        f"marker {high} is at {x:.0f}, {y:.0f} mm from marker {low}, not {expected[0]:g}, {expected[1]:g} mm: it "
        "belongs to another board, or was glued elsewhere"
    )


def _orders(board: Board) -> Iterator[tuple[str, list[int]]]:
    """Other assignments of the eight corners to the markers: a description, and their order."""
    low, high = board.marker_ids
    first, second = [0, 1, 2, 3], [4, 5, 6, 7]
    yield f"markers {low} and {high} are swapped", [*second, *first]
    for quarters in (1, 2, 3):
        turned = [(i + quarters) % 4 for i in range(4)]
        yield f"marker {low} is rotated by {90 * quarters} deg", [*turned, *second]
        yield f"marker {high} is rotated by {90 * quarters} deg", [*first, *(4 + i for i in turned)]


def _second_place(seen: Array, points: Array, camera: Camera, limit_px: float) -> Array | None:
    """Position of the second marker on the plate, (2,) m from the first, if that explains all corners."""
    shift = np.zeros(3)
    T = planar_poses(seen[:4], points[:4], camera)[0]
    second = np.arange(8) >= 4
    for _ in range(_STEPS):
        moved = points + second[:, None] * shift
        by_pose = pose_jacobian(T, moved, camera)
        by_shift = by_pose[..., :2] * second[:, None, None]
        J = np.concatenate([by_pose, by_shift], axis=-1).reshape(-1, 8)
        residual = seen - camera.project(moved @ T[:3, :3].T + T[:3, 3])
        if not np.isfinite(residual).all():
            return None
        step, *_ = np.linalg.lstsq(J, residual.reshape(-1), rcond=None)
        T = T @ transform(rotation(step[3:6]), step[:3])
        shift[:2] += step[6:]
    moved = points + second[:, None] * shift
    off = seen - camera.project(moved @ T[:3, :3].T + T[:3, 3])
    if not np.isfinite(off).all() or _rms(off) >= limit_px:
        return None
    return np.asarray((moved[4:].mean(axis=0) - moved[:4].mean(axis=0))[:2])


def _rms(off: Array) -> float:
    return float(np.sqrt(np.mean(off**2)))
