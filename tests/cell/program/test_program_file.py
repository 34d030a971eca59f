"""Program files: what they say is what the program has, and what is wrong is refused with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import transform
from cell.config.arm_file import ArmFile
from cell.config.inputs import changes
from cell.files.task import POSES
from cell.program.path_step import PathStep
from cell.program.program_file import PROGRAM, is_program, place_of_file, read_program, task_of_file
from cell.program.steps import Action, JointStep, PoseStep
from programs.pallets import pallet
from programs.program_files import PROGRAM as TEXT
from programs.program_files import WIRE, program
from programs.tool_cells import tool_cell
from typed.command_line import a465, replace_in


def test_the_steps_of_a_program_are_read_in_order(tmp_path: Path) -> None:
    task = read_program(program(tmp_path))
    assert (task.kind, task.title, task.name, task.repeat) == (PROGRAM, "a test", "program", 1)
    assert task.required == pytest.approx(0.006)
    np.testing.assert_allclose(np.degrees(task.q_end), [0, 0, -45, 0, -45, 0])
    assert [type(step) for step in task.steps] == [PoseStep, Action, PathStep, JointStep]
    pose, action, path, joints = task.steps
    assert isinstance(pose, PoseStep)
    np.testing.assert_allclose(pose.T_work_tool[0, :3, 3], [0, 0, 0.3])
    np.testing.assert_allclose(pose.T_work_tool[0, :3, 2], [0, 0, 1], atol=1e-12)
    assert action == Action("steps[0]", "above", None, 0.5)
    assert isinstance(path, PathStep)
    assert path.threaded is None
    ends = path.poses.T_work_tool[[0, -1], :3, 3]
    np.testing.assert_allclose(ends, [[0, 0, 0.26], [0, 0, 0.03]], atol=1e-12)
    np.testing.assert_allclose(path.poses.T_work_tool[:, :3, 2] - [0, 0, 1], 0.0, atol=1e-12)
    assert isinstance(joints, JointStep)
    np.testing.assert_allclose(
        task.T_on_work, transform(np.diag([-1, -1, 1]), (0.46, 0.0, 0.033)), atol=1e-12
    )
    assert [body.name for body in task.bodies] == ["bar", "block"]
    placed = {body.name: body.T_base_body[:3, 3] for body in task.bodies_at(task.T_on_work)}
    np.testing.assert_allclose(placed["block"], [0.46 - 0.1, 0.0, 0.033 + 0.01], atol=1e-12)


def test_joint_angles_in_rad_are_told(tmp_path: Path) -> None:
    file = program(tmp_path)
    assert read_program(file).doubts() == ()
    replace_in(file, "end_deg = [0, 0, -45, 0, -45, 0]", "end_deg = [-1.05, -0.7, -1.4, 0, -1.05, 0]")
    replace_in(file, "joints_deg = [0, 0, -45, 0, -45, 0]", "joints_deg = [0.5, -0.7, -1.4, 0, -1.05, 0]")
    end, joints = read_program(file).doubts()
    assert end.startswith(
        "program.toml: end_deg = [-1.05, -0.7, -1.4, 0, -1.05, 0]: is it in rad? Then it must"
    )
    assert joints.startswith(
        "program.toml: steps[2].joints_deg = [0.5, -0.7, -1.4, 0, -1.05, 0]: is it in rad?"
    )
    said, _ = a465("reach", file, code=3, cwd=tmp_path)
    assert f"NOTE: {end}\nNOTE: {joints}\n" in said


def test_a_change_of_a_file_or_of_a_key_is_named(tmp_path: Path) -> None:
    file = program(tmp_path)
    before = read_program(file)
    (file.parent / "wire.toml").write_text(WIRE + "# a comment changes nothing\n")
    assert read_program(file).digest == before.digest
    replace_in(file.parent / "wire.toml", "[10, 10, 200]", "[10, 10, 201]")
    replace_in(file, "dwell_s = 0.5", "dwell_s = 0.6")
    now = read_program(file)
    assert now.digest != before.digest
    named = changes(before.inputs, now.inputs)
    assert any(word.startswith("file wire.toml ") for word in named)
    assert "steps[above].dwell_s 0.5, now 0.6" in named


def test_the_content_of_a_file_decides_what_it_is(tmp_path: Path) -> None:
    file = program(tmp_path)
    assert is_program(file)
    assert not is_program(file.parent / "cell.toml")
    assert task_of_file(file).kind == PROGRAM
    assert task_of_file(file.parent / "cell.toml").kind == POSES
    assert task_of_file(file.parent / "cell.toml").boards == ()
    assert not isinstance(place_of_file(file), ArmFile)


def test_a_work_on_a_board_needs_that_board_in_the_cell(tmp_path: Path) -> None:
    file = program(tmp_path)
    replace_in(file, "[work]", "[work]\nboard = [1, 2]")
    task = read_program(file)
    assert [board.name for board in task.boards] == ["01-02"]
    replace_in(file, "board = [1, 2]", "board = [1, 3]")
    with pytest.raises(InputError, match=r"work.board = \[1, 3\]: must be the two marker ids of a board"):
        read_program(file)


def test_every_body_of_a_file_has_a_name_that_no_look_gives(tmp_path: Path) -> None:
    file = program(tmp_path)
    replace_in(file.with_name("wire.toml"), 'name = "bar"', 'name = "cube 7"')
    more = '\n[[bodies]]\nname = "bar"\ncentre_mm = [0, 0, 300]\nsize_mm = [10, 10, 10]\n'
    file.with_name("wire.toml").write_text(file.with_name("wire.toml").read_text() + more)
    with pytest.raises(InputError, match=r"bodies\[0\].*: has a body 'cube 7'; names that begin"):
        read_program(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('program = "a test"', "program = 7", r"program = 7: must be a string"),
        ("clearance_mm = 6", "clearance_mm = 4", r"clearance_mm = 4: must be at least 5 \(motion.least_clearance"),
        ("end_deg = [0, 0, -45, 0, -45, 0]", "end_deg = [0, 0, 0, 0, 0, 200]", r"end_deg = .*J6"),
        ('name = "block"', 'name = "bar"', r"bodies\[1\].*: has the body 'bar' a second time"),
        ('name = "block"', 'name = "wrist"', r"bodies.*: has the body 'wrist', which the arm or the cell has too"),
        ("dwell_s = 0.5", "points_mm = [[0, 0, 0], [0, 0, 1]]", r"steps\[0\].at_mm.*cannot be combined with points_mm"),
        ("at_mm = [0, 0, 300]\n", "", r"steps\[0\].rpy_deg|steps\[0\]"),
        ('line_of = "wire.toml"', 'line_of = "none.toml"', r"steps\[1\].line_of = .*names a file that does not exist"),
        ('axis = "along"', 'axis = "up"', r"steps\[1\].axis = 'up': must be along, against, or a direction"),
        ('axis = "along"', "axis = [0, 0, 0]", r"steps\[1\].axis = \[0, 0, 0\]: must be along"),
        ('axis = "along"\n', "", r"steps\[1\].axis: is missing"),
        ('axis = "along"', 'axis = "along"\nthreaded = "bar"', r"steps\[1\].threaded = 'bar': must be a body of"),
        ("dwell_s = 0.5", 'threaded = "ring"', r"steps\[0\].threaded.*is a key of a step with points_mm"),
        ("extend_mm = [60, -30]", "extend_mm = [60, -270]", r"steps\[1\].*nothing is left of a path of 200 mm"),
        ('free = "rz"\ntilt', 'free = "rw"\ntilt', r"steps\[1\].free = 'rw': has 'rw'; must be names of directions"),
        ('free = "rz"\ntilt', 'free = "rx"\ntilt', r"steps\[1\].free = 'rx': must be rz, or nothing, on a path"),
        ('touch = [["ring", "bar"]]', 'touch = [["ring"]]', r"steps\[1\].touch\[0\].*must be the names of two"),
        ('touch = [["ring", "bar"]]', 'touch = [["ring", "bat"]]', r"touch.*'bat'.*is no body.*\(there are .*bar, "),
        ('axis = "along"', 'axis = "along"\nclearance_of = ["rong"]', r"steps\[1\].clearance_of.*'rong'.*is no body"),
        ('name = "wire"', 'name = "end"', r"steps\[1\].name = 'end': is the name of a place that every program has"),
        ("joints_deg = [0, 0, -45, 0, -45, 0]", "joints_deg = [0, 0, -45]", r"steps\[2\].joints_deg = .*6 numbers"),
        ("joints_deg = [0, 0, -45, 0, -45, 0]", "joints_deg = [0, 0, 0, 0, 0, 200]", r"steps\[2\].joints_deg.*J6"),
        ("joints_deg = [0, 0, -45, 0, -45, 0]", 'name = "above"', r"steps\[2\].*: must have one of"),
        ('name = "wire"', 'name = "above"', r"steps\[1\].name = 'above': is also the name of steps\[0\]"),
        ("dwell_s = 0.5", 'jaws = "close"', r"steps\[0\].jaws.*has no jaws; leave it out"),
        ("dwell_s = 0.5", "grid.count = [20, 20, 20]", r"steps\[0\].grid.count = .*makes 8000 places"),
        ("clearance_mm = 6", "clearance_mm = 6\nrepeat = 0", r"repeat = 0: must be a whole number from 1 to 1000"),
        ('name = "block"', 'name = "plate 3"', r"bodies\[1\].*: has a body 'plate 3'; names that begin"),
        ('name = "block"', 'name = "stand x"', r"bodies\[1\].*: has a body 'stand x'; names"),
        ('name = "block"', 'name = "cube 1"', r"bodies\[1\].*: has a body 'cube 1'; names"),
        ('name = "block"', 'name = "a\\nb"', r"bodies\[1\].name = .*must be a string of one line"),
        ('file = "wire.toml"', 'file = "FILE"', r"bodies\[0\].file = .*cannot be read: File name too"),
        ('axis = "along"', "axis = [0, 0, 1]\nwindow_mm = 9", r"steps\[1\].window_mm = 9: needs axis along or against"),
        ("clearance_mm = 6", "clearance_worth_s_per_mm = 1", r'worth_s_per_mm = 1: needs aim = "clearance", and'),
        ("clearance_mm = 6", "clearance = 6", r"clearance.*is not a known key .did you mean clearance_mm"),
    ],
)  # fmt: skip
def test_wrong_programs_are_refused_with_place_and_rule(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    file = program(tmp_path)
    replace_in(file, old, new.replace("FILE", "a" * 5000))
    with pytest.raises(InputError, match=message) as caught:
        read_program(file)
    assert "program.toml" in str(caught.value)


def test_a_cell_of_cubes_has_no_program(tmp_path: Path) -> None:
    cell = tool_cell(tmp_path)
    assert not is_program(cell.with_name("task2.toml"))


@pytest.mark.parametrize("name", ["plate x", "stand 01-02", "cube 1"])
def test_a_body_has_no_name_of_what_a_look_finds(tmp_path: Path, name: str) -> None:
    with pytest.raises(
        InputError, match="names that begin with plate, stand or cube are of what a look finds"
    ):
        read_program(program(tmp_path, TEXT.replace('name = "block"', f'name = "{name}"')))


@pytest.mark.parametrize(("lift", "told"), [(3, True), (4.9, True), (5, False)])
def test_strokes_that_touch_begin_at_the_clearance(scenes: Path, lift: float, told: bool) -> None:
    replace_in(file := scenes / "pen/drawing.toml", "lift_mm = 5", f"lift_mm = {lift}")
    if not told:
        read_program(file)
        return
    with pytest.raises(
        InputError, match=rf"steps\[0\].lift_mm = {lift}: must be at least the clearance, 5 mm: where"
    ):
        read_program(file)


def test_a_part_in_cm_is_told(tmp_path: Path) -> None:
    assert read_program(pallet(tmp_path)).doubts() == ()
    for box, told in (("[4.4, 4.4, 3.6]", "[44, 44, 36]"), ("[44, 4.4, 36]", "[440, 44, 360]")):
        file = pallet(tmp_path, ("part.box_mm = [44, 44, 36]", f"part.box_mm = {box}"))
        (doubt,) = read_program(file).doubts()
        assert doubt == f"{file.name}: part.box_mm = {box}: is it in cm? Then it must be {told} in mm"


def test_arcs_to_strokes_are_at_most_200_mm(tmp_path: Path) -> None:
    drawing = 'svg = "a.svg"\nwidth_mm = 100\nlift_mm = 201\naxis = [0, 0, -1]\n'
    text = TEXT.replace(
        'line_of = "wire.toml"\nbackwards = true\nextend_mm = [60, -30]\naxis = "along"\n', drawing
    )
    file = program(tmp_path, text)
    (file.parent / "a.svg").write_text('<svg viewBox="0 0 5 5"><line x2="1"/></svg>')
    with pytest.raises(InputError, match=r"lift_mm = 201: must be a number in mm from 0.5 to 200"):
        read_program(file)
    replace_in(file, "lift_mm = 201\n", "")
    with pytest.raises(InputError, match=r"lift_mm: is missing; it must be a number in mm from 0.5 to 200"):
        read_program(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('program = "', 'title = "', r"toml: program: is missing; it must be a string .title is not a known key"),
        ('program = "', 'task = "', r"toml: program: is missing; it must be a string .task is not a known key"),
    ],
)  # fmt: skip
def test_a_program_without_its_key_is_told_as_a_program(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    file = program(tmp_path)
    replace_in(file, old, new)
    with pytest.raises(InputError, match=message):
        task_of_file(file)


def test_a_drawing_where_a_wire_belongs_is_told(tmp_path: Path) -> None:
    file = program(tmp_path)
    (file.parent / "a.svg").write_text("<svg/>")
    replace_in(file, 'line_of = "wire.toml"', 'line_of = "a.svg"')
    with pytest.raises(
        InputError, match=r"line_of = 'a.svg': names a drawing, must name a wire file .svg takes"
    ):
        read_program(file)
