"""The watch on a cell's camera: take the background once, compare each look with it, and say what was found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array, apply
from cell.config.cell import Cell
from vision.background.camera_shift import CameraShift, require_one_scene
from vision.background.features import Background, background_features, read_background
from vision.background.watch import CameraWatch, distance_to_plane
from vision.camera.model import Image
from vision.observation import Observation
from vision.observe import look

MARGIN = 0.015  # m about a plate
HEIGHT = 0.06  # m above a plate, of the cubes in it


def camera_watch(cell: Cell) -> CameraWatch | None:
    """Return the watch on the camera of a cell, or None if its file names no background.

    Raises:
        InputError: the background cannot be read, or was taken for another calibration of the camera.
    """
    if cell.background_file is None:
        return None
    return watch_with(read_background(cell.background_file, cell.camera), cell)


def watch_with(background: Background, cell: Cell) -> CameraWatch:
    """Return the watch that compares the camera of a cell with a background at its table."""
    height = distance_to_plane(cell.camera.T_base_camera, cell.table_z)
    return CameraWatch(background, height, cell.camera_moved)


def look_in(
    cell: Cell, images: Sequence[Image], arm_in_view: bool = False, watch: CameraWatch | None = None
) -> Observation:
    """Detect the boards and cubes of a cell in images by its camera; see `vision.observe.look`."""
    sizes = cell.cube_size, cell.board_limits
    return look(images, cell.camera, cell.boards, cell.dictionary, *sizes, arm_in_view, cell.tilts, watch)


def take_background(cell: Cell, images: Sequence[Image]) -> tuple[Background, Observation]:
    """Choose the features of the background in images of the cell at rest, outside its boards.

    Raises:
        InputError: an image has the wrong size, or shows a marker of no board of the cell.
        ImpossibleError: a board is refused or partly in view, too few features are seen, or the images show
            different scenes.
    """
    seen = look_in(cell, images)
    if seen.half_seen:
        name = seen.half_seen[0]
        raise ImpossibleError(
            f"board {name} is partly in view, so what it covers is unknown: {seen.missing[name]}; move it into view, "
            "or out of it",
            board=name,
        )
    covered = list(_covered(cell, seen))
    background = background_features(seen.images, cell.camera, covered)
    require_one_scene(background, seen.images, cell.camera)
    return background, seen


def shift_words(shift: CameraShift | None) -> str | None:
    """Return a line about a camera that has certainly moved, or None."""
    if shift is None or not shift.is_certain:
        return None
    return (
        f"the camera has moved by {shift.describe()} since its calibration, which is corrected "
        f"({shift.seen} features of the background agree)"
    )


def _covered(cell: Cell, seen: Observation) -> Iterator[Array]:
    """Yield the outline of each board with its cubes and its stand down to the table, (16, 2) px."""
    corners = np.array([(i, j) for i in (-1, 1) for j in (-1, 1)])
    for board in seen.boards:
        of = board.pose.board.plate
        square = corners * (np.array(of.size[:2]) / 2.0 + MARGIN) + of.centre
        top = apply(board.pose.T_base_board, np.insert(square, 2, HEIGHT, axis=1))
        plate = apply(board.pose.T_base_board, np.insert(square, 2, 0.0, axis=1))
        table = plate.copy()
        table[:, 2] = cell.table_z
        yield cell.camera.project_base(np.concatenate([top, plate, table]))
