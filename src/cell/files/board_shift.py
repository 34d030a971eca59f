"""How far a board has moved since it was seen: of all points of it and of its cubes the one that moved farthest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, PLATE_CENTRE, PLATE_SIZE, Board
from arm.se3 import Array, angle_between, apply
from cell.config.cell import Cell


@dataclass(frozen=True)
class BoardShift:
    """A board's motion between two poses.

    Attributes:
        farthest: that any point of the plate or of a cube in it moved, m.
        turn: of the board, rad.
    """

    farthest: float
    turn: float

    def beyond(self, cell: Cell) -> bool:
        """Whether the board moved further, or turned more, than the cell lets it unnoticed."""
        return self.farthest > cell.moved or self.turn > cell.turned

    def __str__(self) -> str:
        return f"{1e3 * self.farthest:.1f} mm and {np.degrees(self.turn):.2f} deg"


def board_shift(board: Board, cube_size: float, T_then: Array, T_now: Array) -> BoardShift:
    """Its motion from one pose T_base_board to another.

    The points of a rigid body that move farthest are among the corners of any box around it: how far a point moves is
    a convex function of where it is on the body.

    Args:
        board: that moved.
        cube_size: of the cubes in its holes, m.
        T_then, T_now: (4, 4).
    """
    reach = cube_size / np.sqrt(2.0)  # of a cube, whichever way it is turned
    half = np.array(PLATE_SIZE[:2]) / 2.0
    low = np.minimum(np.array(PLATE_CENTRE) - half, board.holes[:, :2].min(axis=0) - reach)
    high = np.maximum(np.array(PLATE_CENTRE) + half, board.holes[:, :2].max(axis=0) + reach)
    top = max(cube_size - CUBE_SEAT_DEPTH, 0.0)
    corners = [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (-PLATE_SIZE[2], top)]
    apart = apply(T_now, corners) - apply(T_then, corners)
    farthest = float(np.sqrt((apart * apart).sum(axis=1).max()))
    return BoardShift(farthest, angle_between(T_then[:3, :3], T_now[:3, :3]))
