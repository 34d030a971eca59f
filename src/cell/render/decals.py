"""What is printed on a plate and cut into it: two markers with a white border, and four pockets."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from arm.board import POCKET_FLOOR, POCKET_MOUTH, SECOND_MARKER, Board
from arm.se3 import Array

WHITE, BLACK = 235.0, 22.0
POCKET_WALL, POCKET_BOTTOM, FINGER_HOLE = 105.0, 75.0, 18.0
POCKET_DEPTH = 0.010  # m
FINGER_RADIUS = 0.008  # m


def marker_bits(dictionary: str, marker_id: int) -> npt.NDArray[np.uint8]:
    """Cells of a marker with its black border, row 0 at the top; 1 is white."""
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    cells = known.markerSize + 2
    image = cv2.aruco.generateImageMarker(known, marker_id, cells, borderBits=1)
    return np.asarray(image > 127, dtype=np.uint8)


class PlateDecals:
    """Brightness of a plate's top, before shading, as a function of the board's coordinates."""

    def __init__(self, board: Board, dictionary: str) -> None:
        self._board = board
        self._markers = [
            (centre, marker_bits(dictionary, marker_id))
            for centre, marker_id in zip(((0.0, 0.0), SECOND_MARKER), board.marker_ids, strict=True)
        ]

    def paint(self, grey: Array, x: Array, y: Array, slope_x: Array, slope_y: Array) -> None:
        """Paint on `grey` (n,) at points (x, y) m of the plate's top.

        Args:
            grey: albedo, changed in place.
            x, y: board coordinates, (n,) m.
            slope_x, slope_y: how far the ray goes sideways per metre of depth below the top, (n,).
        """
        for (cx, cy), bits in self._markers:
            self._paint_marker(grey, x - cx, y - cy, bits)
        for hole in self._board.holes:
            self._paint_pocket(grey, x - hole[0], y - hole[1], slope_x, slope_y)

    def _paint_marker(self, grey: Array, x: Array, y: Array, bits: npt.NDArray[np.uint8]) -> None:
        size, cells = self._board.marker_size, len(bits)
        border = size / 2.0 + size / cells
        inside = np.flatnonzero((np.abs(x) <= border) & (np.abs(y) <= border))
        column = np.floor((x[inside] / size + 0.5) * cells).astype(int)
        row = np.floor((0.5 - y[inside] / size) * cells).astype(int)
        on = (column >= 0) & (column < cells) & (row >= 0) & (row < cells)
        white = np.ones(len(inside), dtype=bool)
        white[on] = bits[row[on], column[on]] == 1
        grey[inside] = np.where(white, WHITE, BLACK)

    def _paint_pocket(self, grey: Array, x: Array, y: Array, slope_x: Array, slope_y: Array) -> None:
        mouth, floor = POCKET_MOUTH / 2.0, POCKET_FLOOR / 2.0
        inside = np.flatnonzero((np.abs(x) <= mouth) & (np.abs(y) <= mouth))
        fx = x[inside] + POCKET_DEPTH * slope_x[inside]
        fy = y[inside] + POCKET_DEPTH * slope_y[inside]
        on_floor = (np.abs(fx) <= floor) & (np.abs(fy) <= floor)
        level = np.where(np.abs(fx) > np.abs(fy), POCKET_WALL, POCKET_WALL + 12.0)
        level = np.where(on_floor, POCKET_BOTTOM, level)
        grey[inside] = np.where(np.hypot(fx, fy) <= FINGER_RADIUS, FINGER_HOLE, level)
