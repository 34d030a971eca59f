"""Cell, task and world files: the shipped ones are good, and every mistake is one line with file, key and value."""

import re
from pathlib import Path

import pytest

from arm.errors import FileInputError, InputError
from cell.config.cell_file import read_cell
from cell.config.inputs import changes
from cell.files.task import read_task
from cell.scene.options import options_of
from typed.command_line import replace_in


def test_a_clearance_in_metres_is_told_the_unit_before_the_exception(scenes: Path) -> None:
    replace_in(scenes / "cell.toml", "clearance_mm = 10 ", "clearance_mm = 0.01 ")
    with pytest.raises(InputError) as refused:
        read_cell(scenes / "cell.toml")
    assert str(refused.value).endswith(
        "must be a number in mm from 5 to 100 (the unit is mm: 10 mm is 10, and this is 0.01 mm; "
        "less is a deliberate exception: motion.least_clearance_mm)"
    )


def test_a_limit_of_the_camera_s_shift_needs_a_background(scenes: Path) -> None:
    file = scenes / "cell.toml"
    replace_in(file, "[look]\n", "[look]\ncamera_moved_mm = 2\n")
    with pytest.raises(InputError, match=r"look.camera_moved_mm = 2: needs background.*calibrate background"):
        read_cell(file)
    file.write_text('background = "background.npz"\n' + file.read_text())
    assert read_cell(file).camera_moved == 0.002


def test_a_table_above_the_zone_for_its_boards_is_refused(scenes: Path) -> None:
    replace_in(scenes / "cell.toml", "top_z_mm = 0", "top_z_mm = 217")
    assert read_cell(scenes / "cell.toml").table_z == 0.217
    replace_in(scenes / "cell.toml", "top_z_mm = 217", "top_z_mm = 750")
    with pytest.raises(InputError) as refused:
        read_cell(scenes / "cell.toml")
    assert str(refused.value).endswith(
        "cell.toml: table.top_z_mm = 750: must not be above the zone for boards, which ends at z = 218 mm by "
        "boards.zone_centre_mm = [470, -10, 110] and boards.zone_size_mm = [440, 540, 216] (heights are z in the base "
        "frame, 0 in the arm's mounting plane, not above the floor)"
    )


def test_how_an_acceleration_builds_up_is_the_cell_files(scenes: Path) -> None:
    task = scenes / "task2.toml"
    assert options_of(read_task(task), 0.5).jerk_time == 0.0
    replace_in(scenes / "cell.toml", "[motion]", "[motion]\njerk_time_s = 0.15")
    assert options_of(read_task(task), 0.5).jerk_time == 0.15
    replace_in(scenes / "cell.toml", "jerk_time_s = 0.15", "jerk_time_s = -1")
    with pytest.raises(InputError, match="jerk_time_s = -1: must be a number in s from 0 to 2"):
        read_task(task)


def test_the_solver_of_lines_is_the_cell_files(scenes: Path) -> None:
    task = scenes / "task2.toml"
    assert options_of(read_task(task), 0.5).solver == "daqp"
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + '\n[solver]\nlines = "osqp"\n')
    assert options_of(read_task(task), 0.5).solver == "osqp"
    replace_in(scenes / "cell.toml", 'lines = "osqp"', 'lines = "quick"')
    with pytest.raises(InputError, match=r"solver\.lines = 'quick': must be one of daqp, osqp"):
        read_task(task)


def test_what_times_motions_is_the_cell_files(scenes: Path) -> None:
    task = scenes / "task2.toml"
    assert options_of(read_task(task), 0.5).timing == "own"
    replace_in(scenes / "cell.toml", "[motion]", '[motion]\ntiming = "toppra"')
    assert options_of(read_task(task), 0.5).by_toppra
    replace_in(scenes / "cell.toml", "[motion]", "[motion]\njerk_time_s = 0.1")
    with pytest.raises(
        InputError, match=r"cell.toml: motion.timing = 'toppra': must be own with a jerk limit"
    ):
        options_of(read_task(task), 0.5)


def test_only_what_is_meant_counts(scenes: Path) -> None:
    """Comments, the way a number is written, and what a plan does not rest on: still the same task."""
    task = read_task(scenes / "task2.toml")
    replace_in(scenes / "cell.toml", "clearance_mm = 10 ", "clearance_mm = 10.0 # ten")
    replace_in(scenes / "cell.toml", "speed = 0.5", "speed = 0.25")
    replace_in(scenes / "cell.toml", "photographs = 5", "photographs = 7")
    replace_in(scenes / "task2.toml", "seed = 0", "seed = 0 # no choice")
    same = read_task(scenes / "task2.toml")
    assert same.cell.speed == 0.25
    assert same.digest == task.digest
    assert changes(task.cell.inputs, same.cell.inputs) == []
    for file, old, new, told in (
        ("cell.toml", "clearance_mm = 10.0", "clearance_mm = 12", "motion.clearance_mm 10, now 12"),
        (
            "cell.toml",
            "[930, 0, 600]",
            "[930, 0, 610]",
            "walls[camera post].centre_mm [930, 0, 600], now [930, 0, 610]",
        ),
        ("cell.toml", 'name = "camera post"', 'name = "pole"', "walls[camera post] is gone"),
        ("boards/positions_plate_03-04.csv", "80,60", "80,61", "board 03-04 "),
        ("cell.toml", "[motion]", "[motion]\njerk_time_s = 0.1", "motion.jerk_time_s is new"),
    ):
        before = (scenes / file).read_text()
        if old not in before:
            old = before.splitlines()[2]
            new = old.split(",")[0] + ",61.5"
        replace_in(scenes / file, old, new)
        other = read_task(scenes / "task2.toml")
        assert other.digest != task.digest
        assert any(words.startswith(told) for words in changes(task.cell.inputs, other.cell.inputs)), told
        (scenes / file).write_text(before)
    replace_in(scenes / "task2.toml", 'look_after = "each"', "look_after = 2")
    assert changes(task.inputs, read_task(scenes / "task2.toml").inputs) == ["look_after each, now 2"]


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (
            "cell.toml",
            'unit = "crs93"',
            'unit = "crs39"',
            r"unit = 'crs39': must be one of crs93, crs97, or a unit file .* \(did you mean",
        ),
        (
            "cell.toml",
            "length_mm = 134.112",
            "length_mm = 50",
            "must be at least that of fingers and palm, 55.412 mm",
        ),
        (
            "cell.toml",
            "length_mm = 134.112",
            "lenght_mm = 134.112",
            r"tool.length_mm: is missing; .*lenght_mm",
        ),
        ("cell.toml", "jaw_opening_mm = 60", "jaw_opening_mm = 40", "more than the cube's 40 mm"),
        (
            "cell.toml",
            "photographs = 5",
            "photographs = 0",
            "look.photographs = 0: must be a whole number from 1",
        ),
        (
            "cell.toml",
            "clearance_mm = 10",
            "clearance_mm = 4.9",
            "motion.clearance_mm = 4.9: must be a number in mm from 5",
        ),
        ("cell.toml", "speed = 0.5", "speed = 1.5", "motion.speed = 1.5"),
        (
            "cell.toml",
            "-80, 0, -60, 0]",
            "-115, 0, -60, 0]",
            "q_start_deg.*J3 must be from -109.0 to 109.0 deg",
        ),
        ("cell.toml", "positions_plate_01-02", "positions_plate_02-01", "boards.files.*does not exist"),
        ("cell.toml", "DICT_4X4_50", "DICT_4X4_49", "did you mean 'DICT_4X4_50'"),
        (
            "cell.toml",
            "[look]",
            "[look]\nfotographs = 5",
            "look.fotographs = 5: is not a known key .*photographs",
        ),
        (
            "cell.toml",
            "centre_mm = [350, 0] ",
            "centre_mm = [0.35, 0] ",
            r"table.centre_mm = \[0.35, 0\]: must be 2 mm or more from the arm's axis.*is it in metres\?",
        ),
        (
            "cell.toml",
            "zone_centre_mm = [470, -10, 110]",
            "zone_centre_mm = [0.47, -0.01, 0.11]",
            r"boards.zone_centre_mm = \[0.47, .*is it in metres\?",
        ),
        (
            "cell.toml",
            "centre_mm = [930, 0, 600]",
            "centre_mm = [0.93, 0, 0.6]",
            r"walls\[0\].centre_mm = \[0.93, .*is it in metres\?",
        ),
        ("cell.toml", "[tool]", "[tool", "is not valid TOML"),
        (
            "cell.toml",
            "centre_mm = [930, 0, 600]",
            "position_mm = [930, 0, 600]",
            r"walls\[0\].position_mm is not a known key: did you mean walls\[0\].centre_mm\?",
        ),
        (
            "cell.toml",
            "# speed_registers = [7680, 2048",
            "speed_registers = [7680, 9999",
            "axis B must be at most 4096",
        ),
        (
            "cell.toml",
            "cameras/lab.toml",
            "cameras/lap.toml",
            "camera = 'cameras/lap.toml': names a file that does not exist",
        ),
        ("cell.toml", 'name = "camera post"', 'name = "table"', "used twice"),
        ("boards/positions_plate_01-02.csv", "0,80", "a,80", r"positions_plate_01-02.csv: line 2 = 'a,80'"),
        (
            "boards/positions_plate_03-04.csv",
            "3,4",
            "2,4",
            "positions_plate_01-02.csv and boards/positions_plate_03-04.csv both have 2",
        ),
        (
            "task2.toml",
            "from_board = [1, 2]",
            "from_board = [1, 3]",
            r"from_board = \[1, 3\]: must be the two marker ids",
        ),
        ("task2.toml", "to_board = [3, 4]", "to_board = [1, 2]", "another board"),
        (
            "task2.toml",
            "to_board = [3, 4]",
            "to_board = [3, 4]\nto_holes = [1, 2, 1]",
            r"to_holes = \[1, 2, 1\]: must be different whole numbers from 1 to 4",
        ),
        ("task2.toml", "to_board = [3, 4]", "to_board = [3, 4]\nto_holes = [0]", "different whole numbers"),
        ("task2.toml", "to_board = [3, 4]", "to_board = [3, 4]\nto_holes = []", "different whole numbers"),
        ("task2.toml", "board-to-board", "board2board", "must be one of clear-board, board-to-board"),
        ("task2.toml", "cell.toml", "cel.toml", "does not exist"),
        (
            "task2.toml",
            'look_after = "each"',
            "look_after = 0",
            "look_after = 0: must be one of each, never, or a number of cubes, 1 or more",
        ),
        ("task2.toml", 'look_after = "each"', "look_after = true", "look_after = True: must be one of each"),
        ("task2.toml", 'order = "free"', 'order = "fre"', "order = 'fre': must be one of free, given"),
        ("task2.toml", 'assignment = "free"', "assignment = 1", "assignment = 1: must be one of free, given"),
        (
            "cell.toml",
            "# acceleration_fraction = 0.5",
            "acceleration_fraction = 1.5",
            "motion.acceleration_fraction = 1.5: must be a number from 0.01 to 1",
        ),
        ("task1.toml", "count = [4, 2]", "count = [1, 3]", "at least four"),
        ("task1.toml", "step_mm = [75, 75]", "step_mm = [45, 75]", "places.step_mm"),
    ],
)
def test_mistakes_are_told(scenes: Path, file: str, old: str, new: str, message: str) -> None:
    replace_in(scenes / file, old, new)
    task = "task1.toml" if file == "task1.toml" else "task2.toml"
    with pytest.raises(InputError, match=message) as error:
        read_task(scenes / task)
    assert error.value.exit_code == 2
    assert "\n" not in str(error.value)


def test_a_misspelt_key_is_named_even_where_another_is_missing(scenes: Path) -> None:
    cell = scenes / "cell.toml"
    for key, wrong in (("speed ", "speeed "), ("rest_tolerance_counts", "rest_tolerence_counts")):
        text = (
            cell.read_text()
            if key in cell.read_text()
            else cell.read_text().replace("[motion]", f"[motion]\n{key} = 25")
        )
        other = re.sub(r"(?m)^approach_mm_s.*$", "", text.replace(f"\n{key}", f"\n{wrong}"))
        (scenes / "wrong.toml").write_text(other)
        with pytest.raises(FileInputError) as told:
            read_cell(scenes / "wrong.toml")
        assert "approach_mm_s: is missing" in str(told.value)
        assert f"motion.{wrong.strip()} is not a known key: did you mean motion.{key.strip()}?" in str(
            told.value
        )


def test_an_unknown_key_is_named_even_where_none_is_like_it_and_a_value_is_wrong(scenes: Path) -> None:
    cell = scenes / "cell.toml"
    replace_in(cell, "[motion]", "[motion]\nxyz = 1")
    replace_in(cell, "speed = 0.5", "speed = 5")
    with pytest.raises(FileInputError, match=r"speed = 5: must be .*motion.xyz is not a known key\)"):
        read_cell(cell)
    replace_in(cell, "speed = 5", "speed = 0.5")
    with pytest.raises(
        FileInputError, match=r"motion.xyz = 1: is not a known key \(known: .*velocity_fraction"
    ):
        read_cell(cell)


def test_a_tolerance_that_lets_a_cube_out_from_between_the_jaws_is_refused(
    scenes: Path,
) -> None:
    """Open jaws of 60 mm around a cube of 40 leave 10 mm a side, of which a line keeps 5."""
    replace_in(scenes / "cell.toml", "moved_mm = 1.5", "moved_mm = 5.1")
    with pytest.raises(InputError, match=r"look.moved_mm = 5.1: must be at most 5 mm: .*jaw_opening_mm"):
        read_cell(scenes / "cell.toml")
    replace_in(scenes / "cell.toml", "moved_mm = 5.1", "moved_mm = 5")
    read_cell(scenes / "cell.toml")
