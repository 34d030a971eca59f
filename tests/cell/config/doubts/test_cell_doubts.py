"""What a cell file may have in another unit or place is told, and not refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.errors import InputError
from cell.commands.plan_poses import plan_poses_step
from cell.commands.run import _note_open_items
from cell.commands.steps import _doubt
from cell.config.cell_file import read_cell
from cell.config.doubts.cell_doubts import cell_doubts
from cell.console import Console
from cell.doctor.cell import check_cell
from cell.files.reading import Reading
from cell.files.task import read_task
from cell.session.connection import WhichCell
from typed.command_line import replace_in
from vision.observation import Observation


def test_a_start_that_may_be_in_rad_is_told_and_not_refused(
    scenes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, line = scenes / "cell.toml", "q_start_deg = [-60, -40, -80, 0, -60, 0]"
    for right in ("[-60.5, -40, -80, 0, -60, 0]", "[0, 0, 0, 0, 0, 0]", "[-3, -2, -1, 0, -3, 0]"):
        replace_in(file, line, line := f"q_start_deg = {right}")
        assert cell_doubts(read_cell(file)) == ()
    replace_in(file, line, "q_start_deg = [-1.0472, -0.6981, -1.3963, 0, -1.0472, 0]")
    (doubt,) = cell_doubts(read_cell(file))
    assert doubt == (
        "cell.toml: q_start_deg = [-1.0472, -0.6981, -1.3963, 0, -1.0472, 0]: is it in rad? Then it must be "
        "[-60.0001, -39.9982, -80.0021, 0, -60.0001, 0] in deg; as it is, the arm is within 3.2 deg of zero in all "
        "joints"
    )
    cell, *_ = check_cell(file)[0]
    assert (cell.verdict, cell.help) == ("note", doubt)
    none = scenes / "none.csv"
    with pytest.raises(InputError, match=r"no such file|cannot be read"):
        plan_poses_step(file, none, None, scenes / "p.json", Reading(), None, True, Console())
    assert f"NOTE: {doubt}\n" in capsys.readouterr().out
    _note_open_items(read_task(scenes / "task2.toml"), WhichCell(), Console())
    assert f"NOTE: {doubt}\n" in capsys.readouterr().out
    _doubt(read_cell(file), Observation(), Console())
    assert f"NOTE: {doubt}\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("right", "in_cm", "beyond"),
    [
        ("size_mm = [1300, 1500]", "size_mm = [130, 150]", 275),
        ("centre_mm = [350, 0]", "centre_mm = [-350, 0]", 390),
    ],
)
def test_a_table_that_does_not_carry_the_zone_for_boards_is_told(
    scenes: Path, right: str, in_cm: str, beyond: int
) -> None:
    replace_in(file := scenes / "cell.toml", right, in_cm)
    assert cell_doubts(read_cell(file)) == (
        f"cell.toml: table.centre_mm and table.size_mm: the zone for boards reaches {beyond} mm beyond the table; are "
        "they in cm? The arm is not kept away from what is not in the file",
    )


def test_a_post_whose_foot_is_given_for_its_middle_is_told(scenes: Path) -> None:
    replace_in(file := scenes / "cell.toml", "centre_mm = [930, 0, 600]", "centre_mm = [930, 0, 0]")
    (doubt,) = cell_doubts(read_cell(file))
    assert doubt == (
        "cell.toml: walls[0] (camera post): its lower half is below the table's top: is centre_mm that of its foot? "
        "Its middle is 600 mm above it"
    )


def test_fingers_whose_length_stands_first_are_told(scenes: Path) -> None:
    replace_in(file := scenes / "cell.toml", "finger_mm = [20, 10, 25.4]", "finger_mm = [25.4, 20, 10]")
    (doubt,) = cell_doubts(read_cell(file))
    assert doubt == (
        "cell.toml: tool.finger_mm = [25.4, 20.0, 10.0]: with tool.grip_height_mm = 15 the palm is 7 mm inside a "
        "gripped cube: is the third of them the length from palm to tip?"
    )


def test_a_wall_around_the_base_is_told(scenes: Path) -> None:
    file = scenes / "cell.toml"
    wall = '\n[[walls]]\nname = "cage"\ncentre_mm = [0, 0, 1000]\nsize_mm = [2000, 2000, 2000]\n'
    file.write_text(file.read_text() + wall)
    (doubt,) = cell_doubts(read_cell(file))
    assert doubt.startswith("cell.toml: walls[1] (cage): the arm's base is ")
    assert doubt.endswith(" A body is solid: a cage is a wall for each of its sides")


def test_stands_and_grippers_in_cm_are_told_and_not_refused(scenes: Path) -> None:
    file = scenes / "cell.toml"
    assert cell_doubts(read_cell(file)) == ()
    stand = next(line for line in file.read_text().splitlines() if line.startswith("stand_size_mm"))
    replace_in(file, stand, "stand_size_mm = [30, 20]")  # a profile
    assert cell_doubts(read_cell(file)) == ()
    replace_in(file, "stand_size_mm = [30, 20]", "stand_size_mm = [12, 12]")
    for key, right, in_cm in (
        ("finger_mm", "[20, 10, 25.4]", "[2.4, 1, 4]"),
        ("palm_mm", "[50, 84, 30.012]", "[6, 9, 3.5]"),
        ("body_radius_mm", "32", "3.6"),
    ):
        replace_in(file, f"{key} = {right}", f"{key} = {in_cm}")
    end = "in mm; as it is, clearances are those of a body that is this small"
    assert cell_doubts(read_cell(file)) == (
        f"cell.toml: boards.stand_size_mm = [12, 12]: is it in cm? Then it must be [120, 120] {end}",
        f"cell.toml: tool.finger_mm = [2.4, 1, 4]: is it in cm? Then it must be [24, 10, 40] {end}",
        f"cell.toml: tool.palm_mm = [6, 9, 3.5]: is it in cm? Then it must be [60, 90, 35] {end}",
        f"cell.toml: tool.body_radius_mm = [3.6]: is it in cm? Then it must be [36] {end}",
    )
