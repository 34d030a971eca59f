"""How far a board has moved: no less than any point of it or of a cube in it, and no more than a box around them."""

from __future__ import annotations

import numpy as np
import pytest

from arm.board import CUBE_SEAT_DEPTH, PLATE_CENTRE, PLATE_SIZE, Board
from arm.se3 import Array, apply, rotation, transform
from cell.files.board_shift import board_shift

CUBE = 0.04
# as near to the plate's corners as pockets may be: half of a turned cube's diagonal stands out
EDGE = Board("e", (1, 2), np.array([(a, b, 0.0) for a in (-0.005, 0.185) for b in (0.0, 0.14)]), 0.036)
MIDDLE = Board("m", (1, 2), np.array([(a, b, 0.0) for a in (0.06, 0.12) for b in (0.05, 0.09)]), 0.036)


def points(board: Board) -> Array:
    """Corners of the plate, and of a cube in each hole, however it is turned."""
    x, y, z = (np.array([-0.5, 0.5]) * size for size in PLATE_SIZE)
    plate = [
        (PLATE_CENTRE[0] + a, PLATE_CENTRE[1] + b, c - PLATE_SIZE[2] / 2) for a in x for b in y for c in z
    ]
    around = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    reach = CUBE / np.sqrt(2.0)
    cubes = [
        (hole[0] + reach * np.cos(a), hole[1] + reach * np.sin(a), h)
        for hole in board.holes
        for a in around
        for h in (-CUBE_SEAT_DEPTH, CUBE - CUBE_SEAT_DEPTH)
    ]
    return np.array([*plate, *cubes])


@pytest.mark.parametrize("board", [EDGE, MIDDLE], ids=["holes at the edge", "holes in the middle"])
def test_what_moves_farthest_is_found_and_little_more(board: Board) -> None:
    """Little: of the box around cubes at the edge a corner stands out by 6 mm more than any cube."""
    rng, at = np.random.default_rng(1), points(board)
    for _ in range(300):
        then = transform(rotation(rng.normal(size=3)), rng.uniform(-0.5, 0.5, 3))
        turn_ = rng.normal(size=3) * rng.choice([0.0, 0.02, 0.5])
        turn_ *= (
            rng.permutation([1.0, 0.0, 0.0]) if rng.random() < 0.5 else 1.0
        )  # about one of its axes, or any
        pivot = rng.uniform(-0.5, 0.5, 3)
        moved = transform(t=pivot) @ transform(rotation(turn_)) @ transform(t=-pivot)
        now = then @ moved
        farthest = np.linalg.norm(apply(now, at) - apply(then, at), axis=1).max()
        shift = board_shift(board, CUBE, then, now)
        assert farthest - 1e-9 <= shift.farthest
        turn = 2.0 * np.sin(shift.turn / 2.0)
        assert shift.farthest <= farthest + turn * (0.02 if board is EDGE else 0.035) + 1e-9


def test_a_body_on_the_board_counts_as_well() -> None:
    """The top of a wire 0.18 m high moves further than any point of the plate."""
    top = np.array([[0.05, 0.15, 0.3]])
    then, now = np.eye(4), transform(rotation((0.017, 0.0, 0.0)))
    shift = board_shift(MIDDLE, CUBE, then, now, top)
    assert shift.farthest == pytest.approx(np.linalg.norm(apply(now, top) - top))
    assert shift.farthest > board_shift(MIDDLE, CUBE, then, now).farthest


def test_a_cube_that_is_sunk_in_its_pocket_stands_no_higher_than_the_plate() -> None:
    """Only the plate moves then: about an axis in its top, its corners at the bottom are the farthest."""
    tilt = transform(rotation((0.1, 0.0, 0.0)))
    shift = board_shift(MIDDLE, CUBE_SEAT_DEPTH / 2.0, np.eye(4), tilt)
    _, y = (np.array(PLATE_CENTRE) + np.array(PLATE_SIZE[:2]) / 2.0).tolist()
    assert shift.farthest == pytest.approx(2.0 * np.sin(0.05) * np.hypot(y, PLATE_SIZE[2]))
