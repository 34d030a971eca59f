"""A plate of one's own, with markers and holes elsewhere, is a file: cubes are taken from it and put into it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.board import PLATE
from arm.errors import FileInputError
from cell.config.cell_file import read_cell
from cell.config.plain_board import read_board
from tasks.small import quick_scenes
from typed.command_line import a465, replace_in

pytestmark = pytest.mark.xdist_group("own_plate")
HOLES = [[60, 10], [60, 100], [130, 10], [130, 100]]
FILE = """
markers = [{0}, {1}]
marker_size_mm = 34
second_marker_mm = [200, 120]
size_mm = [260, 180, 22]
centre_mm = [100, 60]
holes_mm = [[60, 10], [60, 100], [130, 10], [130, 100]]
"""


def with_own_plates(scenes: Path) -> Path:
    """The scenes, with two other plates in place of those of the second task."""
    for low, high in ((1, 2), (3, 4)):
        (scenes / f"boards/own_{low}.toml").write_text(FILE.format(low, high))
        for file in ("cell.toml", "task2.world.toml"):
            replace_in(scenes / file, f"positions_plate_{low:02d}-{high:02d}.csv", f"own_{low}.toml")
    return scenes


def test_a_plate_is_as_its_file_says(scenes: Path) -> None:
    before = read_cell(scenes / "cell.toml")
    cell = read_cell(with_own_plates(scenes) / "cell.toml")
    board = cell.boards[0]
    assert (board.name, board.marker_size, board.plate.size) == ("01-02", 0.034, (0.26, 0.18, 0.022))
    np.testing.assert_allclose(1e3 * board.holes, np.pad(HOLES, ((0, 0), (0, 1))))
    assert board.second_marker == (0.2, 0.12)
    assert cell.boards[2].plate is PLATE
    changed = {key for key in before.inputs if before.inputs[key] != cell.inputs[key]}
    assert changed == {"board 01-02", "board 03-04"}
    replace_in(scenes / "boards/own_1.toml", "[60, 100]", "[60, 101]")
    assert read_cell(scenes / "cell.toml").inputs["board 01-02"] != cell.inputs["board 01-02"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[60, 10]", "[44, 10]", r"holes_mm\[0\] = \[44, 10\]: lies on the marker at 0, 0 mm"),
        ("[130, 100]", "[160, 100]", r"holes_mm\[3\] = \[160, 100\]: lies on the marker at 200, 120 mm"),
        (
            "[60, 100]",
            "[60, 130]",
            r"holes_mm\[1\] = \[60, 130\]: puts its mouth of 44 mm partly off the plate",
        ),
        (
            "[130, 10]",
            "[100, 10]",
            r"holes_mm\[2\] = \[100, 10\]: is 40 mm from hole 1: mouths of 44 mm would",
        ),
        (
            "180, 22]",
            "180, 10]",
            r"size_mm = \[260, 180, 10\]: must be thicker than its pockets, which are 10 mm deep",
        ),
        ("holes_mm = [[60, 10], ", "holes_mm = [", "holes_mm = .*: must be 4 rows of 2 numbers"),
    ],
)
def test_holes_that_this_plate_cannot_have_are_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    file = tmp_path / "own.toml"
    file.write_text(FILE.format(1, 2))
    assert len(read_board(file, 0.036).holes) == 4
    replace_in(file, old, new)
    with pytest.raises(FileInputError, match=message):
        read_board(file, 0.036)


@pytest.mark.slow
def test_a_cube_is_brought_from_one_to_the_other(tmp_path: Path) -> None:
    scenes = with_own_plates(quick_scenes(tmp_path, 1, 4))
    said, _ = a465("run", scenes / "task2.toml", "--time-scale", "100", "--json", cwd=tmp_path)
    cubes = json.loads(said)["cubes"]
    assert [cube["placed"] for cube in cubes] == [True, True]
    assert max(cube["error_mm"] for cube in cubes) < 1.0
    assert {cube["from"] for cube in cubes} == {"01-02/1", "01-02/4"}
