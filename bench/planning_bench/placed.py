"""Boards that are placed, and the gap between two of them seen from above."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import PLATE_CENTRE, PLATE_SIZE, Board
from arm.numerics.products import mul, norm
from arm.se3 import Array, apply, frozen


@dataclass(frozen=True)
class Placed:
    """A board and where it stands."""

    board: Board
    T_base_board: Array

    def T_base_hole(self, index: int) -> Array:
        return frozen(mul(self.T_base_board, self.board.T_board_hole(index)))

    def outline(self) -> Array:
        half = np.array(PLATE_SIZE[:2]) / 2
        square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + PLATE_CENTRE
        return apply(self.T_base_board, np.column_stack([square, np.zeros(4)]))


@dataclass(frozen=True)
class Gap:
    """The widest straight strip between two plates seen from above: unit normal (2,), middle (2,), width m."""

    normal: Array
    middle: Array
    width: float


def gap_between(a: Placed, b: Placed) -> Gap:
    """Among strips along an edge of either plate; negative width if they overlap."""
    flats = [p.outline()[:, :2] for p in (a, b)]
    best = Gap(np.array([1.0, 0.0]), np.zeros(2), -np.inf)
    for flat in flats:
        for edge in np.roll(flat, -1, axis=0) - flat:
            normal = np.array([edge[1], -edge[0]]) / norm(edge)
            normal = normal * np.sign(mul(flats[1].mean(axis=0) - flats[0].mean(axis=0), normal))
            low, high = float((mul(flats[0], normal)).max()), float((mul(flats[1], normal)).min())
            if high - low > best.width:
                middle = (flats[0].mean(axis=0) + flats[1].mean(axis=0)) / 2
                middle = middle + ((low + high) / 2 - mul(middle, normal)) * normal
                best = Gap(normal, middle, high - low)
    return best
