"""How a cube rests, told from its pose alone."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import Array, inverse, rot_x, rot_z, rotation, transform
from cell.contact.resting import SEATED, resting
from cell.files.world import read_world
from cell.scene.bodies import T_hole_cube

BOARDS = read_world(data_file("scenes/task2.world.toml"), 0.036).boards
CUBE = 0.04


def _at(T_seat_cube: Array, board: int = 1, hole: int = 2) -> str:
    b = BOARDS[board]
    T = b.T_base_board @ b.board.T_board_hole(hole) @ T_hole_cube(CUBE) @ T_seat_cube
    found = resting(T, CUBE, BOARDS, 0.0)
    assert found.where != "pocket" or found.place == f"{b.board.name}/{hole + 1}"
    return found.what


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_a_seated_cube_is_placed_whichever_side_is_up(turn: float) -> None:
    assert _at(transform(rot_z(turn))) == "placed"
    assert _at(transform(rot_x(turn))) == "placed"


def test_a_cube_is_placed_up_to_the_limit_of_its_lowest_corners() -> None:
    assert _at(transform(t=(0.0, 0.0, 0.98 * SEATED))) == "placed"
    assert _at(transform(t=(0.0, 0.0, 1.02 * SEATED))) == "unseated"
    assert _at(transform(t=(0.0, 0.0, -1.02 * SEATED))) == "unseated"


@pytest.mark.parametrize(("corner", "reach"), [((0.0, 1.0), 1.0), ((1.0, 1.0), np.sqrt(2.0))])
def test_a_cube_is_placed_while_its_highest_corner_is_low(corner: tuple[float, float], reach: float) -> None:
    x, y = corner
    stays = transform(
        t=(-x * CUBE / 2.0, -y * CUBE / 2.0, -CUBE / 2.0)
    )  # edge or corner about which it leans
    for share, what in ((0.97, "placed"), (1.03, "unseated")):
        angle = share * SEATED / (reach * CUBE)
        leaning = rotation(np.array([y, -x, 0.0]) / np.hypot(x, y) * angle)
        assert _at(stays @ transform(leaning) @ inverse(stays)) == what


@pytest.mark.parametrize("aside", [(0.006, 0.0), (0.0, -0.025), (0.015, 0.015)])
def test_a_cube_on_the_plate_is_unseated(aside: tuple[float, float]) -> None:
    assert _at(transform(t=(*aside, 0.008))) == "unseated"


def test_elsewhere_a_cube_is_set_down_or_fallen() -> None:
    standing = transform(rot_z(0.3), (0.2, 0.35, CUBE / 2.0))
    assert resting(standing, CUBE, BOARDS, 0.0).what == "set down"
    leaning = transform(rot_x(0.1), (0.2, 0.35, CUBE / 2.0 + 0.002))
    assert resting(leaning, CUBE, BOARDS, 0.0).what == "fallen"
    assert resting(transform(t=(0.2, 0.35, 0.3)), CUBE, BOARDS, 0.0).what == "fallen"
