"""The five ways of the course report's lessons, side by side: each gives T_camera_board from the same corners."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from arm.board import Board
from arm.se3 import Array, rotation, rotation_vector, transform
from boards_bench.scenes import Frames
from vision.boards.pose import assess_board
from vision.boards.pose_fit import Corners, fit_weighted, planar_poses
from vision.camera.model import Camera

Way = Callable[[Board, Frames, Camera], Array]


def one_marker(board: Board, frames: Frames, camera: Camera) -> list[Array]:
    """The better planar pose of the first marker in each photograph, T_camera_board."""
    points = board.marker_corners()[0]
    seen = (next(m for m in frame if m.id == board.marker_ids[0]) for frame in frames)
    return [planar_poses(marker.corners_px, points, camera)[0] for marker in seen]


def single(board: Board, frames: Frames, camera: Camera) -> Array:
    """One marker, one photograph."""
    return one_marker(board, frames[:1], camera)[0]


def vector_median(board: Board, frames: Frames, camera: Camera) -> Array:
    """One marker, median of translations and of rotation vectors: the course report's first try."""
    poses = one_marker(board, frames, camera)
    vectors = np.median([rotation_vector(T[:3, :3]) for T in poses], axis=0)
    return transform(rotation(vectors), np.median([T[:3, 3] for T in poses], axis=0))


def element_median(board: Board, frames: Frames, camera: Camera) -> Array:
    """One marker, median of every element of the matrix, made a rotation again."""
    middle = np.median(one_marker(board, frames, camera), axis=0)
    U, _, V = np.linalg.svd(middle[:3, :3])
    return transform(U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V, middle[:3, 3])


def corner_median(board: Board, frames: Frames, camera: Camera) -> Array:
    """Both markers, median of every corner, then one pose: the course report's final recipe."""
    corners = np.median([[m.corners_px for m in frame] for frame in frames], axis=0).reshape(1, 8, 2)
    points = board.marker_corners().reshape(8, 3)
    start = planar_poses(corners[0], points, camera)[0]
    return fit_weighted(Corners(corners, points), np.ones((1, 8)), start, camera).T_camera_board


def joint(board: Board, frames: Frames, camera: Camera) -> Array:
    """All corners of all photographs in one robust estimate: `vision.boards.pose`."""
    seen = assess_board(board, frames, camera)
    return np.full((4, 4), np.nan) if seen.pose is None else camera.T_camera_base @ seen.pose.T_base_board


WAYS: dict[str, Way] = {
    "one marker, one photograph": single,
    "one marker, rotation-vector median": vector_median,
    "one marker, element median": element_median,
    "two markers, corner median": corner_median,
    "two markers, joint (ours)": joint,
}
