"""Tell whether another board with the same markers is in view, though none of its markers shows as a whole.

A marker behind a wire, or cut by the image's edge, is not detected. What remains of it still looks like its code. So
the image is mapped to the plane of the board that was found, and both codes are compared with it at all places and
rotations (normalised cross-correlation). In photographs of a real cell, remains of markers correlate by 0.70 and more
with their codes, everything else by 0.51 at most (bench/results/real-cell-2026-11-26.md).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from arm.board import Board
from arm.errors import ImpossibleError
from arm.se3 import Array, Bools, apply
from vision.camera.model import Camera
from vision.markers.dictionaries import marker_modules
from vision.markers.edge_profiles import Grey

Floats = npt.NDArray[np.float32]

ALIKE = 0.62  # least correlation of what remains of a marker with its code
AROUND = 0.5  # how far from the middle of the board copies are looked for, along its x and y, m
PIXELS = 20  # of the map, across a marker
TURN_DEG = 10  # step of the rotations
INSIDE = 0.6  # part of a marker and its white border that must be inside the image
OWN = 0.8  # marker sizes from the centre of a board's own markers within which nothing is a copy


def other_copy(
    image: Grey,
    board: Board,
    T_camera_board: Array,
    camera: Camera,
    dictionary: str,
    others: Sequence[int] = (),
) -> ImpossibleError | None:
    """Return the doubt that another board with the same markers is in view, if one is.

    Args:
        image: (h, w).
        board: the board that was found.
        T_camera_board: its pose.
        camera: the camera; its extrinsics are not used.
        dictionary: of the markers.
        others: ids of markers of other boards that may be in view; they look somewhat alike.
    """
    on_board, px, inside = _map(board, T_camera_board, camera)
    if not inside.any():
        return None
    smooth = cv2.blur(image, (3, 3))
    seen = np.asarray(
        cv2.remap(smooth, px[..., 0], px[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE),
        dtype=np.float32,
    )
    own = board.marker_corners().mean(axis=1)[:, :2]
    apart = np.linalg.norm(on_board[..., None, :] - own, axis=-1).min(axis=-1) > OWN * board.marker_size
    alike = np.stack([_correlation(seen, inside, i, dictionary) for i in board.marker_ids]) * apart
    while alike.max() >= ALIKE:
        which, row, column = (int(k) for k in np.unravel_index(int(np.argmax(alike)), alike.shape))
        most, here = float(alike[which, row, column]), _around(row, column, PIXELS // 2)
        about = _around(row, column, 2 * PIXELS)
        middle = _around(min(row, 2 * PIXELS), min(column, 2 * PIXELS), 3)  # of `about`
        codes = [_correlation(seen[about], inside[about], i, dictionary)[middle] for i in others]
        if max((float(code.max()) for code in codes), default=0.0) <= most:
            return _doubt(board, board.marker_ids[which], px[row, column], most)
        alike[(slice(None), *here)] = 0.0
    return None


def _around(row: int, column: int, by: int) -> tuple[slice, slice]:
    """The part of a map about a place."""
    return slice(max(row - by, 0), row + by + 1), slice(max(column - by, 0), column + by + 1)


def _doubt(board: Board, marker_id: int, at: Floats, alike: float) -> ImpossibleError:
    x, y = at.tolist()
    return ImpossibleError(
        f"board {board.name}: a second marker {marker_id} shows in part, at {x:.0f}, {y:.0f} px, so another board with "
        "the same ids is in view; which one is meant cannot be told, and a pose is never made of markers of two "
        "boards: remove one, or give it ids of its own",
        board=board.name,
        marker=marker_id,
        marker_px=[x, y],
        alike=alike,
    )


def _map(board: Board, T_camera_board: Array, camera: Camera) -> tuple[Array, Floats, Bools]:
    """A grid on the board's plane: points (h, w, 2) m, their pixels (h, w, 2), and which are inside the image."""
    step = board.marker_size / PIXELS
    along = step * np.arange(-round(AROUND / step), round(AROUND / step) + 1)
    x, y = board.plate.centre
    grid = np.stack(np.meshgrid(x + along, y - along), axis=-1)
    px = camera.project(apply(T_camera_board, np.pad(grid, ((0, 0), (0, 0), (0, 1)))))
    within = (px >= 0.0) & (px <= np.array(camera.size) - 1.0)  # NaN compares false
    inside: Bools = np.asarray(within.all(axis=-1))
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    if len(rows):
        part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        grid, px, inside = grid[part], px[part], inside[part]
    return grid, np.asarray(np.nan_to_num(px, nan=-1.0), dtype=np.float32), inside


def _correlation(seen: Floats, inside: Bools, marker_id: int, dictionary: str) -> Array:
    """Best correlation over all turns of a marker centred at each point of a map; 0 where too little is inside."""
    modules = marker_modules(dictionary, marker_id)
    white = np.pad(modules, 1, constant_values=True).astype(np.float32)
    edge = round(PIXELS * len(white) / len(modules))
    code = cv2.resize(white, (edge, edge), interpolation=cv2.INTER_AREA)
    half = int(np.ceil(edge / 2**0.5))
    around = (half, half, half, half)
    frame = cv2.copyMakeBorder(seen, *around, cv2.BORDER_REPLICATE)
    within = cv2.copyMakeBorder(inside.astype(np.float32), *around, cv2.BORDER_CONSTANT, value=0.0)
    best = np.zeros(seen.shape)
    middle, size = (edge - 1) / 2.0, (2 * half + 1, 2 * half + 1)
    for turn in range(0, 360, TURN_DEG):
        M = cv2.getRotationMatrix2D((middle, middle), turn, 1.0)
        M += np.array([[0.0, 0.0, half - middle]])
        pattern, mask = cv2.warpAffine(code, M, size), cv2.warpAffine(np.ones_like(code), M, size)
        alike = cv2.matchTemplate(frame, pattern, cv2.TM_CCOEFF_NORMED, mask=mask)
        enough = cv2.matchTemplate(within, mask, cv2.TM_CCORR) >= INSIDE * float(mask.sum())
        best = np.maximum(best, np.where(enough & np.isfinite(alike), alike, 0.0))
    return best
