"""A plate with its pockets as convex pieces: a physics engine knows no hollow bodies."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from arm.board import POCKET_DEPTH, Board
from arm.robot.shapes import Box, Convex
from arm.se3 import Array

FINGER_HOLE = 0.016  # m, width of the hole in a pocket's floor
MOST_RIM = 2e-3  # m, width of a wall's top
_QUARTERS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # directions in which a pocket's walls stand from its axis


@dataclass(frozen=True)
class Piece:
    """A convex piece of a plate.

    Attributes:
        shape: a box, or the hull of points relative to `centre`.
        centre: in the board frame, (3,) m.
    """

    shape: Box | Convex
    centre: tuple[float, float, float]


def plate_pieces(board: Board) -> list[Piece]:
    """The solid of a plate with square funnels and finger holes, as pieces that touch and do not overlap.

    A wall is a prism with the funnel's slope, mitred at its corners. Its top is `MOST_RIM` wide where there is room,
    so a cube on the rim rests on one piece.
    """
    rim = _rim(board)
    half = board.pocket[0] / 2.0 + rim
    pieces: list[Piece] = []
    for x, y, _ in board.holes:
        pieces += _walls((x, y), board.pocket, half) + _floor((x, y), half, -board.plate.size[2])
    return pieces + _between(board, half)


def _rim(board: Board) -> float:
    """Width of the walls' tops, m: half the room to the next pocket, and at most that to the plate's edge."""
    mouth = board.pocket[0]
    room = [float(board.plate.edge_distances(board.holes).min()) - mouth / 2.0]
    for index, hole in enumerate(board.holes):
        room += [(float(np.abs(hole - other).max()) - mouth) / 2.0 for other in board.holes[:index]]
    return min(MOST_RIM, max(min(room), 0.0))


def _walls(axis: tuple[float, float], pocket: tuple[float, float], half: float) -> list[Piece]:
    """The four walls of a funnel, from the plate's top to the pocket's floor."""
    mouth, floor = (width / 2.0 for width in pocket)
    return [
        _hull(
            [
                (axis[0] + r * dx - s * r * dy, axis[1] + r * dy + s * r * dx, z)
                for r, z in ((mouth, 0.0), (half, 0.0), (floor, -POCKET_DEPTH), (half, -POCKET_DEPTH))
                for s in (-1.0, 1.0)
            ]
        )
        for dx, dy in _QUARTERS
    ]


def _floor(axis: tuple[float, float], half: float, low: float) -> list[Piece]:
    """What is below a funnel, around its finger hole; `low` is the plate's underside."""
    hole, high = FINGER_HOLE / 2.0, -POCKET_DEPTH
    spans = [
        ((-half, half), (hole, half)),
        ((-half, half), (-half, -hole)),
        ((-half, -hole), (-hole, hole)),
        ((hole, half), (-hole, hole)),
    ]
    return [
        _box([(axis[0] + x[0], axis[1] + y[0], low), (axis[0] + x[1], axis[1] + y[1], high)])
        for x, y in spans
    ]


def _between(board: Board, half: float) -> list[Piece]:
    """The plate beside the squares of 2 `half` around its holes: strips between their edges, cut by the squares."""
    size = np.array(board.plate.size)
    low = np.array(board.plate.centre) - size[:2] / 2.0
    high = low + size[:2]
    edges = sorted(
        {float(low[1]), float(high[1]), *(float(h[1] + s) for h in board.holes for s in (-half, half))}
    )
    pieces = []
    for y0, y1 in pairwise(edges):
        cut = sorted(
            (float(h[0] - half), float(h[0] + half))
            for h in board.holes
            if abs(h[1] - (y0 + y1) / 2.0) < half
        )
        starts = [float(low[0]), *(end for _, end in cut)]
        ends = [*(begin for begin, _ in cut), float(high[0])]
        pieces += [
            _box([(x0, y0, -float(size[2])), (x1, y1, 0.0)])
            for x0, x1 in zip(starts, ends, strict=True)
            if x1 - x0 > 1e-6 and y1 - y0 > 1e-6
        ]
    return pieces


def _box(corners: list[tuple[float, float, float]]) -> Piece:
    low, high = np.array(corners)
    x, y, z = (float(v) for v in high - low)
    return Piece(Box((x, y, z)), _point((low + high) / 2.0))


def _hull(points: list[tuple[float, float, float]]) -> Piece:
    centre = np.mean(points, axis=0)
    return Piece(Convex(tuple(_point(p - centre) for p in np.array(points))), _point(centre))


def _point(p: Array) -> tuple[float, float, float]:
    x, y, z = p.tolist()
    return x, y, z
