"""The pieces of a plate fill it, without overlap, and leave its funnels and finger holes free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from arm.board import PLATE_CENTRE, PLATE_SIZE, POCKET_DEPTH, Board, read_board_csv
from arm.io.storage import data_file
from arm.robot.shapes import Box
from arm.se3 import Array, frozen
from cell.contact.plate import FINGER_HOLE, Piece, plate_pieces

FILES = sorted(data_file("scenes/boards").glob("*.csv"))
BOARDS = [read_board_csv(file, 0.036) for file in FILES]
TOUCHING = replace(
    BOARDS[0], holes=frozen([(0.1, 0.0, 0), (0.144, 0.02, 0), (0.188, 0.0, 0), (0.0, 0.148, 0)])
)


def _volume(piece: Piece) -> float:
    if isinstance(piece.shape, Box):
        return float(np.prod(piece.shape.size))
    return float(ConvexHull(piece.shape.points).volume)


def _inside(piece: Piece, points: Array) -> Array:
    local = points - piece.centre
    if isinstance(piece.shape, Box):
        return np.asarray((np.abs(local) <= np.array(piece.shape.size) / 2.0).all(axis=1))
    faces = ConvexHull(piece.shape.points).equations
    return np.asarray((local @ faces[:, :3].T + faces[:, 3] <= 0.0).all(axis=1))


def _is_solid(board: Board, points: Array) -> Array:
    mouth, floor = board.pocket
    solid = np.ones(len(points), dtype=bool)
    for hole in board.holes:
        off = np.abs(points[:, :2] - hole[:2]).max(axis=1)
        width = mouth + (floor - mouth) * -points[:, 2] / POCKET_DEPTH
        width = np.where(points[:, 2] < -POCKET_DEPTH, FINGER_HOLE, width)
        solid &= off > width / 2.0
    return solid


@pytest.mark.parametrize("board", [*BOARDS, TOUCHING, replace(BOARDS[0], pocket=(0.0445, 0.0385))])
def test_pieces_are_the_plate_less_its_pockets(board: Board) -> None:
    pieces = plate_pieces(board)
    mouth, floor = board.pocket
    funnel = POCKET_DEPTH * (mouth * mouth + mouth * floor + floor * floor) / 3.0
    finger = FINGER_HOLE**2 * (PLATE_SIZE[2] - POCKET_DEPTH)
    asked = np.prod(PLATE_SIZE) - 4.0 * (funnel + finger)
    assert sum(map(_volume, pieces)) == pytest.approx(asked, rel=1e-9)
    rng = np.random.default_rng(7)
    low = np.array([*(np.array(PLATE_CENTRE) - np.array(PLATE_SIZE[:2]) / 2.0), -PLATE_SIZE[2]])
    points = low + rng.random((20_000, 3)) * PLATE_SIZE
    covered = np.sum([_inside(piece, points) for piece in pieces], axis=0)
    assert np.array_equal(covered == 1, _is_solid(board, points))
    assert covered.max() == 1
