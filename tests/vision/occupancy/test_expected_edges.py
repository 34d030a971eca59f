"""Borders of cubes and pockets: where they are predicted is where their edges are seen; which of them tell."""

from __future__ import annotations

import numpy as np
import pytest

from arm.board import CUBE_SEAT_DEPTH, POCKET_DEPTH, POCKET_FLOOR, POCKET_MOUTH
from arm.se3 import Array
from pictures.boards import CUBE, lab_board
from vision.occupancy.expected_edges import FINGER_HOLE_RADIUS, Border, Kind, hole_borders

NEAR = 2.1e-3
EYES = [(0.0, 0.0), (0.15, 0.05), (-0.3, 0.2), (0.1, -0.45)]  # beside the hole, at 1.1 m over it


def eye_over(hole: Array, x: float, y: float) -> Array:
    return hole + (x, y, 1.1)


def of(kind: Kind, borders: tuple[list[Border], list[Border]]) -> list[Border]:
    return [b for of_state in borders for b in of_state if b.kind == kind]


def at_height(points: Array, height: float, eye: Array) -> Array:
    """Places (n, 2) at a height over the plate on the eye's rays to points (n, 2) of the plate."""
    return eye[:2] + (points - eye[:2]) * (eye[2] - height) / eye[2]


@pytest.mark.parametrize(("x", "y"), EYES)
def test_borders_are_seen_where_the_edges_are(x: float, y: float) -> None:
    board = lab_board()
    eye = np.array([x, y, 1.1])
    borders = hole_borders(board, 1, eye_over(board.holes[1], x, y), CUBE, NEAR)
    expected: tuple[tuple[Kind, float, float], ...] = (
        ("top", CUBE - CUBE_SEAT_DEPTH, CUBE),
        ("mouth", 0.0, POCKET_MOUTH),
        ("floor", -POCKET_DEPTH, POCKET_FLOOR),
    )
    for kind, height, width in expected:
        sides = of(kind, borders)
        assert len(sides) == 4
        for side in sides:
            there = at_height(side.points, height, eye)
            assert np.abs(np.abs(there).max(axis=1) - width / 2.0).max() < 1e-9
            assert (there @ side.outward.T > 0.0).all()
    (rim,) = of("rim", borders)
    there = at_height(rim.points, -POCKET_DEPTH, eye)
    assert np.linalg.norm(there, axis=1) == pytest.approx(FINGER_HOLE_RADIUS)


@pytest.mark.parametrize(("x", "y", "faces"), [(0.0, 0.0, 0), (0.2, 0.0, 1), (-0.3, 0.2, 2)])
def test_upright_edges_belong_to_faces_towards_the_camera(x: float, y: float, faces: int) -> None:
    board = lab_board()
    borders = hole_borders(board, 1, eye_over(board.holes[1], x, y), CUBE, NEAR)
    assert len(of("upright", borders)) == (0 if faces == 0 else faces + 1)


@pytest.mark.parametrize(("x", "y"), EYES)
def test_telling_stations_keep_away_from_the_other_states_borders(x: float, y: float) -> None:
    board = lab_board()
    for index in range(4):
        borders = hole_borders(board, index, eye_over(board.holes[index], x, y), CUBE, NEAR)
        for mine, theirs in (borders, borders[::-1]):
            others = np.concatenate([b.points[b.clear] for b in theirs])
            for border in mine:
                for point in border.points[border.telling]:
                    assert np.linalg.norm(others - point, axis=1).min() >= NEAR - 0.2e-3
        assert of("rim", borders)[0].telling.mean() > 0.5  # a cube hides a finger hole from everywhere


def test_a_slant_makes_the_top_tell() -> None:
    board = lab_board()
    straight, slanted = (
        of("top", hole_borders(board, 1, eye_over(board.holes[1], x, 0.0), CUBE, NEAR)) for x in (0.0, 0.4)
    )
    assert sum(b.telling.sum() for b in straight) == 0  # between the sides of mouth and floor
    assert sum(b.telling.sum() for b in slanted) > 30


def test_print_and_edges_of_the_plate_do_not_tell() -> None:
    board = lab_board()  # hole 3 at (140, 0) mm, 8 mm from the plate's edge at y = -30 mm
    hole = board.holes[3]
    cube, _ = hole_borders(board, 3, eye_over(hole, 0.0, 0.35), CUBE, NEAR)
    for border in cube:
        on_plate = border.points[border.telling] + hole[:2]
        assert (on_plate[:, 1] > -0.030 + NEAR - 1e-9).all()
    assert any((b.points[:, 1] + hole[1] < -0.030 + NEAR).any() for b in cube)
