"""Boards without holes, of any size: markers where the file says, or refused with its key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.board import PLATE, Plate
from arm.errors import FileInputError
from arm.io.storage import data_file
from arm.poses import BoardPose
from arm.se3 import rot_z, transform
from cell.config.cell_file import read_cell
from cell.config.inputs import config_inputs
from cell.config.plain_board import read_board
from cell.files.board_shift import board_shift
from cell.scene.bodies import plate_body, stand_body
from typed.command_line import replace_in
from vision.boards.checks import Spread

PUZZLE = data_file("scenes/hoop/boards/puzzle_01-02.toml")


def test_the_puzzle_board_is_that_of_the_photographs() -> None:
    """125 x 125 mm, markers of 40 mm 106 mm apart, the foot in the middle."""
    board = read_board(PUZZLE, 0.036)
    assert (board.name, board.marker_ids, board.marker_size) == ("01-02", (1, 2), 0.040)
    assert len(board.holes) == 0
    assert board.tolerance == pytest.approx(3e-4)
    centres = board.marker_corners().mean(axis=1)
    assert np.linalg.norm(centres[1] - centres[0]) == pytest.approx(0.106, abs=1e-4)
    middle = np.array([*board.plate.centre, 0.0])
    np.testing.assert_allclose(centres - middle, [(-0.0375, 0.0375, 0), (0.0375, -0.0375, 0)], atol=1e-12)
    assert board.plate.size == (0.125, 0.125, 0.003)


def test_a_board_with_holes_has_the_plate_of_all_of_them() -> None:
    board = read_board(data_file("scenes/boards/positions_plate_01-02.csv"), 0.036)
    assert board.plate is PLATE
    T = transform(rot_z(0.3), (0.4, 0.1, 0.05))
    assert np.array_equal(plate_body("a", T).T_base_body, plate_body("a", T, board.plate).T_base_body)


def test_plate_and_stand_are_where_the_board_is() -> None:
    board = read_board(PUZZLE, 0.036)
    T = transform(rot_z(0.5), (0.45, 0.02, 0.04))
    plate = plate_body(board.name, T, board.plate)
    corners = np.array([[x, y, 0.0] for x in (-0.025, 0.1) for y in (0.025, -0.1)])
    on_plate = (np.linalg.inv(plate.T_base_body) @ T @ np.c_[corners, np.ones(4)].T).T[:, :3]
    np.testing.assert_allclose(np.abs(on_plate), np.tile([0.0625, 0.0625, 0.0015], (4, 1)), atol=1e-12)
    stand = stand_body(board.name, T, (0.145, 0.145), 0.0, plate=board.plate)
    assert stand is not None
    np.testing.assert_allclose(stand.T_base_body[:2, 3], plate.T_base_body[:2, 3], atol=1e-12)
    assert stand.shape.size[2] == pytest.approx(0.04 - 0.003 - 0.001)  # type: ignore[union-attr]


def test_a_board_without_holes_moves_and_is_certain_as_its_plate() -> None:
    board = read_board(PUZZLE, 0.036)
    turned = transform(rot_z(0.02))
    shift = board_shift(board, 0.04, np.eye(4), turned)
    farthest = 2.0 * np.sin(0.01) * np.hypot(0.1, 0.1)
    assert shift.farthest == pytest.approx(farthest)
    C = np.diag([1e-8, 1e-8, 4e-8, 1e-6, 1e-6, 1e-6])
    spread = Spread.of(BoardPose(board, transform(), C, 0.1, 100.0))
    assert spread.height == pytest.approx(np.sqrt(4e-8 + 2 * 0.0375**2 * 1e-6))
    assert spread.turn == pytest.approx(1e-3)


def test_a_cell_compares_boards_by_what_they_are() -> None:
    cell = read_cell(data_file("scenes/hoop/cell.toml"))
    (board,) = cell.boards
    other = replace(board, plate=Plate((0.13, 0.125, 0.003), board.plate.centre))
    assert config_inputs({}, boards=[board]) != config_inputs({}, boards=[other])
    assert config_inputs({}, boards=[board])["board 01-02"] == cell.inputs["board 01-02"]


def test_the_outline_is_the_plate_s_or_as_measured_and_is_a_choice(tmp_path: Path) -> None:
    board = read_board(PUZZLE, 0.036)
    corners = ((-0.025, 0.025), (0.1, 0.025), (0.1, -0.1), (-0.025, -0.1))
    assert board.outline is not None
    np.testing.assert_allclose(board.outline.corners, corners, atol=1e-12)
    assert board.outline.tolerance == pytest.approx(5e-4)
    file = tmp_path / "board.toml"
    file.write_text(PUZZLE.read_text())
    replace_in(file, "outline_within_mm = 0.5", "outline_within_mm = 0.1 #")
    file.write_text(
        file.read_text() + "outline_mm = [[-25.1, 25], [99.8, 24.9], [99.7, -99.8], [-25, -99.9]]\n"
    )
    measured = read_board(file, 0.036).outline
    assert measured is not None
    np.testing.assert_allclose(measured.corners[1], (0.0998, 0.0249), atol=1e-12)
    replace_in(file, "outline_within_mm", "# outline_within_mm")
    replace_in(file, "outline_mm", "# outline_mm")
    none = read_board(file, 0.036)
    assert none.outline is None
    assert config_inputs({}, boards=[none]) == config_inputs({}, boards=[board])  # plans do not depend on it


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "markers = [1, 2]",
            "markers = [2, 1]",
            r"markers = \[2, 1\]: must be two different ids, the lower one first",
        ),
        ("markers = [1, 2]", "markers = [1]", r"markers = \[1\]: must be 2 whole numbers from 0 to 999"),
        ("marker_size_mm = 40", "", r"marker_size_mm: is missing"),
        ("second_marker_mm = [75, -75]", "second_marker_mm = [20, 20]", r"must be at least 42 mm in x or y"),
        (
            "second_marker_mm = [75, -75]",
            "second_marker_mm = [85, -75]",
            r"second_marker_mm.*partly off the board",
        ),
        ("centre_mm = [37.5, -37.5]", "centre_mm = [50, -37.5]", r"centre_mm = .*partly off the board"),
        ("size_mm = [125, 125, 3]", "size_mm = [125, 125]", r"size_mm = .*must be 3 numbers in mm"),
        (
            "outline_within_mm = 0.5",
            "outline_mm = [[-25, 25], [100, 25], [100, -100], [-25, -100]]",
            r"outline_mm.*needs outline_within_mm",
        ),
        (
            "outline_within_mm = 0.5",
            "outline_within_mm = 0.2\noutline_mm = [[100, 25], [-25, 25], [100, -100], [-25, -100]]",
            r"outline_mm.*top left, top right, bottom right, bottom left",
        ),
        (
            "outline_within_mm = 0.5",
            "outline_within_mm = 0",
            r"outline_within_mm = 0: must be a number in mm",
        ),
    ],
)
def test_wrong_boards_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tmp_path / "board.toml"
    file.write_text(PUZZLE.read_text())
    replace_in(file, old, new)
    with pytest.raises(FileInputError, match=message):
        read_board(file, 0.036)
