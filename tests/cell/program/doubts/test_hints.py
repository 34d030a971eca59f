"""A refusal of a program adds the key of its step that may be wrong, and nothing where none is."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from cell.config.cell_file import read_cell
from cell.program.doubts.hints import hint, reach_of
from cell.program.planning import plan_of_program
from cell.program.program_file import ProgramTask, read_program
from programs.pallets import pallet
from typed.command_line import replace_in
from vision.observation import Observation


def changed(folder: Path, name: str, old: str = "", new: str = "") -> ProgramTask:
    """A program of the shipped scenes with a change."""
    file = Path(shutil.copytree(data_file("scenes"), folder / "scenes")) / name
    if old:
        replace_in(file, old, new)
    return read_program(file)


def hint_of(task: ProgramTask, **data: Any) -> str:
    return hint(task, task.steps[0], ImpossibleError("refused", **data))


def test_another_pair_than_touch_allows_is_told(tmp_path: Path) -> None:
    task = changed(tmp_path, "polish/pass.toml", '[["ball", "block"]]', '[["ball", "clamp"]]')
    assert (
        hint_of(task, pair=["ball", "block"]) == "; touch of this step allows ball - clamp, not ball - block"
    )
    on_path = "; touch of this step allows clamp - ball on its path only, not where it begins and ends"
    assert hint_of(task, pair=["clamp", "ball"]) == on_path
    assert hint_of(task, pair=["upper_arm", "base"]) == ""  # which no touch would allow
    assert hint_of(task) == ""


def test_a_drawing_without_touch_is_told_the_key(tmp_path: Path) -> None:
    task = changed(tmp_path, "pen/drawing.toml", 'touch = [["pen", "table"]]', "")
    told = '; if pen is meant to touch table on it, the step says so: touch = [["pen", "table"]]'
    assert hint_of(task, pair=["pen", "table"]) == hint_of(task, pair=["table", "pen"]) == told
    for pair in (["upper_arm", "table"], ["pen", "upper_arm"]):
        assert hint_of(task, pair=pair) == ""


@pytest.mark.parametrize(
    ("done", "end"),
    [(0.035, "40 mm by which extend_mm prolongs the start"), (0.045, ""), (0.2, "")]
    + [(0.275, ""), (0.285, "20 mm by which extend_mm prolongs the end")],
)
def test_a_place_in_what_extend_adds_is_told(tmp_path: Path, done: float, end: str) -> None:
    task = changed(tmp_path, "hoop/b.toml", "extend_mm = [40, -27.5]", "extend_mm = [40, 20]")
    assert hint_of(task, done_m=done, length_m=0.3) == (end and f"; it is in the {end} of the path")


def test_a_path_that_ends_short_of_its_line_is_not_prolonged(tmp_path: Path) -> None:
    task = changed(tmp_path, "hoop/b.toml")
    assert hint_of(task, done_m=0.295, length_m=0.3) == ""


@pytest.mark.parametrize(("width", "told"), [(2100, True), (700, False)])
def test_a_drawing_larger_than_the_reach_is_told(tmp_path: Path, width: int, told: bool) -> None:
    task = changed(tmp_path, "pen/drawing.toml", "width_mm = 210", f"width_mm = {width}")
    large = (
        "; the path of this step is 1905 x 1285 x 5 mm large, and the arm reaches 861 mm from its shoulder: is "
        "width_mm right?"
    )
    assert hint_of(task, outside_m=1.1) == (large if told else "")
    assert hint_of(task, outside_m=None) == ""


def test_the_arm_never_reaches_further_than_its_reach() -> None:
    cell = read_cell(data_file("scenes/cell.toml"))
    robot, rng = cell.robot(), np.random.default_rng(1)
    reach = reach_of(robot)
    shoulder = robot.model.jointPlacements[1].translation + robot.model.jointPlacements[2].translation
    far = [
        np.linalg.norm(robot.T_base_tool(q)[:3, 3] - shoulder)
        for q in rng.uniform(cell.unit.lower, cell.unit.upper, (500, 6))
    ]
    assert 0.8 * reach < max(far) <= reach + 1e-9


def test_a_part_that_is_put_down_without_a_line_is_told(tmp_path: Path) -> None:
    file = pallet(tmp_path)
    text = file.read_text()
    put = text.index('part = "put"')
    head, step = text[: text.rindex("[[steps]]", 0, put)], text[text.rindex("[[steps]]", 0, put) :]
    file.write_text(head + re.sub(r"(approach|retract)_mm = .*\n", "", step, count=2))
    with pytest.raises(
        ImpossibleError, match=r"; the step has no approach_mm and no retract_mm: a part may touch"
    ):
        plan_of_program(read_program(file), Observation(), 0.5)


def test_a_refused_plan_has_the_hint(tmp_path: Path) -> None:
    task = changed(tmp_path, "hoop/b.toml", "extend_mm = [40, -27.5]", "extend_mm = [-40, 27.5]")
    with pytest.raises(ImpossibleError, match=r"; it is in the 27\.5 mm by which extend_mm prolongs the end"):
        plan_of_program(task, Observation(), 0.5)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("axis = [0, 0, -1]", "axis = [0, 0, 1]", "; the flange would point up, along (0, 0, 1) of the base frame: "),
        ("axis = [0, 0, -1]", "axis = [180, 0, 0]", "; the flange would point sideways, along (0, -1, 0) of the base"),
        ("origin_mm = [380, 105, 1]", "", "; the program has no work.origin_mm, so the workpiece is at the origin of"),
        ("[380, 105, 1]", "[38, 10.5, 0.1]", "; work.origin_mm = [38, 10.5, 0.1] is where the arm's base stands: is"),
        ("[380, 105, 1]", "[0.38, 0.1, 0.1]", "; work.origin_mm = [0.38, 0.1, 0.1] is less than 2 mm from that of the"),
    ],
)  # fmt: skip
def test_what_is_out_of_reach_asks_where_the_flange_points_and_where_the_workpiece_is(
    tmp_path: Path, old: str, new: str, told: str
) -> None:
    task = changed(tmp_path, "pen/drawing.toml", old, new)
    assert told in hint(task, task.steps[0], ImpossibleError("the tool is out of reach"))
    assert hint_of(changed(tmp_path / "plain", "pen/drawing.toml")) == ""
