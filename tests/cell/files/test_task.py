"""Task files."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.files.task import read_place, read_task
from cell.program.program_file import task_of_file
from cell.scene.options import options_of
from typed.command_line import replace_in


def test_the_shipped_tasks_can_be_read(scenes: Path) -> None:
    for name, kind, boards in (("task1", "clear-board", 1), ("task2", "board-to-board", 2)):
        task = read_task(scenes / f"{name}.toml")
        assert (task.name, task.kind, len(task.boards)) == (name, kind, boards)
        assert task.cell.gripper.length == pytest.approx(0.134112)
        assert np.degrees(task.cell.q_start) == pytest.approx([-60, -40, -80, 0, -60, 0])
        assert task.cell.gripper.fraction_closed(task.cell.cube_size) == pytest.approx(1 / 3)


def test_a_folder_is_told_with_its_task_files(scenes: Path, tmp_path: Path) -> None:
    for read in (read_task, read_place):
        with pytest.raises(InputError) as refused:
            read(scenes)
        told = str(refused.value)
        assert "is a folder, must be a file (give a task file of it: " in told
        assert told.endswith(f": {scenes / 'task1.toml'}, {scenes / 'task2.toml'})")
        with pytest.raises(InputError, match="it holds no task file"):
            read(tmp_path)


def test_places_in_metres_are_told_by_their_key(scenes: Path) -> None:
    task = scenes / "task1.toml"
    (line,) = (line for line in task.read_text().splitlines() if line.startswith("origin_mm"))
    replace_in(task, line, "origin_mm = [0.32, -0.215]")
    with pytest.raises(
        InputError, match=r"task1\.toml: places\.origin_mm = \[0\.32, -0\.215\]: .*is it in metres\?"
    ):
        read_task(task)
    replace_in(task, "origin_mm = [0.32, -0.215]", "origin_mm = [0, -300]")
    assert read_task(task).places.centres[0] == pytest.approx((0.0, -0.3))


def test_what_may_be_chosen_is_the_files(scenes: Path) -> None:
    """Free where a file says nothing; what it says reaches the planner."""
    task = scenes / "task2.toml"
    optional = ("look_after", "order", "assignment")
    lines = task.read_text().splitlines(keepends=True)
    task.write_text("".join(line for line in lines if not line.startswith(optional)))
    options = options_of(read_task(task), 0.25)
    assert (options.look, options.order, options.assignment) == ("each", "free", "free")
    assert (options.velocity_fraction, options.acceleration_fraction, options.speed) == (0.9, 0.5, 0.25)
    task.write_text(task.read_text() + 'look_after = 2\norder = "given"\nassignment = "given"\n')
    replace_in(scenes / "cell.toml", "# velocity_fraction = 0.9", "velocity_fraction = 0.8")
    replace_in(scenes / "cell.toml", "# acceleration_fraction = 0.5", "acceleration_fraction = 0.4")
    options = options_of(read_task(task), 0.25)
    assert (options.look, options.order, options.assignment) == (2, "given", "given")
    assert (options.velocity_fraction, options.acceleration_fraction) == (0.8, 0.4)


def test_a_worth_of_clearance_needs_the_aim_that_uses_it(scenes: Path) -> None:
    task = scenes / "task2.toml"
    replace_in(task, "seed = 0", "seed = 0\nclearance_worth_s_per_mm = 0.5")
    rule = r'clearance_worth_s_per_mm = 0.5: needs aim = "clearance", and aim is "time"$'
    for read in (read_task, read_place):
        with pytest.raises(InputError, match=rf"task2\.toml: {rule}"):
            read(task)
    replace_in(task, "seed = 0", 'seed = 0\naim = "clearance"')
    assert read_task(task).clearance_worth == pytest.approx(500.0)


def test_a_name_relative_to_another_folder_is_told(scenes: Path) -> None:
    replace_in(task := scenes / "task2.toml", 'cell = "cell.toml"', 'cell = "my-cell/cell.toml"')
    with pytest.raises(
        InputError, match=r'names are relative to the folder of task2.toml: "cell.toml" is there'
    ):
        read_task(task)


def test_a_task_by_a_link_without_its_cell_beside_it_is_told_with_the_task(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder, link = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")), Path("today.toml")
    link.symlink_to("scenes/task2.toml")
    with pytest.raises(InputError) as refused:
        read_task(link)
    there = folder.resolve() / "task2.toml"
    assert str(refused.value) == (
        "today.toml: cell = 'cell.toml': names a file that does not exist: cell.toml "
        f"(a link leads to {there}, which has it beside it: give that file)"
    )
    (folder / "cell.toml").unlink()
    with pytest.raises(InputError, match=r"does not exist: [^ ]*$"):
        read_task(link)


def test_a_task_with_the_key_of_a_program_is_told_as_a_task(scenes: Path) -> None:
    file = scenes / "task2.toml"
    replace_in(file, "task =", "program =")
    with pytest.raises(
        InputError, match=r"task: is missing; it must be one of .* .program is not a known key"
    ):
        task_of_file(file)


def test_a_step_of_places_in_metres_or_cm_is_told(scenes: Path) -> None:
    file = scenes / "task1.toml"
    for stated, other in (("[0.075, 0.075]", "metres"), ("[7.5, 7.5]", "cm")):
        text = file.read_text()
        replace_in(file, "step_mm = [75, 75]", f"step_mm = {stated}")
        with pytest.raises(InputError, match=rf"places.step_mm = .* 61.5685 to 500 .is it in {other}\?"):
            read_task(file)
        file.write_text(text)


def test_a_yaw_of_places_in_rad_is_told(scenes: Path) -> None:
    file = scenes / "task1.toml"
    assert read_task(file).doubts() == ()
    replace_in(file, "yaw_deg = 0", "yaw_deg = 0.785")
    assert read_task(file).doubts() == (
        "task1.toml: places.yaw_deg = 0.785: is it in rad? Then it must be 44.98 in deg",
    )


def test_more_looks_than_cubes_are_told(scenes: Path) -> None:
    file = scenes / "task2.toml"
    for stated, told in (("4", 0), ("9", 1)):
        replace_in(
            file, 'look_after = "each"' if stated == "4" else "look_after = 4", f"look_after = {stated}"
        )
        found = read_task(file).doubts()
        assert len(found) == told
        assert (
            not found
            or found[0] == "task2.toml: look_after = 9: is more than the 4 cubes of a board: no look follows"
        )
