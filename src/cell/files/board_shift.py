"""Motion of a board between two looks: the largest displacement of any point of the board and of what is on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, Board
from arm.se3 import Array, angle_between, apply
from cell.config.cell import Cell
from cell.files.task import NOTHING, Task
from vision.observation import Observation


@dataclass(frozen=True)
class BoardShift:
    """A board's motion between two poses.

    Attributes:
        farthest: largest displacement of any point of the plate, of a cube in it, or of a body on it, m.
        turn: rotation of the board, rad.
    """

    farthest: float
    turn: float

    def beyond(self, cell: Cell) -> bool:
        """Whether the displacement or the rotation exceeds the cell's tolerance."""
        return self.farthest > cell.moved or self.turn > cell.turned

    def __str__(self) -> str:
        return f"{1e3 * self.farthest:.1f} mm and {np.degrees(self.turn):.2f} deg"


def board_shift(
    board: Board, cube_size: float, T_then: Array, T_now: Array, on_board: Array = NOTHING
) -> BoardShift:
    """Compute the motion of a board from one pose to another.

    The displacement is a convex function of the point on the body, so a corner of any box around the body bounds it.

    Args:
        board: board that moved.
        cube_size: edge of the cubes in its holes, m.
        T_then, T_now: poses T_base_board, (4, 4).
        on_board: corners of boxes around further bodies on the board, in its frame, (k, 3) m.
    """
    reach = cube_size / np.sqrt(2.0)  # half the diagonal of a cube: any yaw
    centre, half = np.array(board.plate.centre), np.array(board.plate.size[:2]) / 2.0
    around = np.concatenate(
        [board.holes[:, :2] - reach, board.holes[:, :2] + reach, [centre - half, centre + half]]
    )
    low, high = around.min(axis=0), around.max(axis=0)
    top = max(cube_size - CUBE_SEAT_DEPTH, 0.0) if len(board.holes) else 0.0
    own = [
        (x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (-board.plate.size[2], top)
    ]
    corners = np.concatenate([own, on_board])
    apart = apply(T_now, corners) - apply(T_then, corners)
    farthest = float(np.sqrt((apart * apart).sum(axis=1).max()))
    return BoardShift(farthest, angle_between(T_then[:3, :3], T_now[:3, :3]))


def moved_boards(before: Observation, now: Observation, task: Task) -> list[str]:
    """Describe the boards that moved beyond the cell's tolerance between two observations, one line per board."""
    lines = [f"board {b.name} has come into view" for b in now.boards if before.board(b.name) is None]
    for old in before.boards:
        new = now.board(old.name)
        if new is None:
            lines.append(f"board {old.name} is no longer in view")
            continue
        T_then, T_now = old.pose.T_base_board, new.pose.T_base_board
        shift = board_shift(old.pose.board, task.cell.cube_size, T_then, T_now, task.on_board)
        if shift.beyond(task.cell):
            lines.append(f"board {old.name} moved by {shift}")
    return lines
