"""A refusal at the command line: the ways that were rejected as a table, advice that holds, all of it in the JSON."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ImpossibleError
from cell.commands.steps import look_step, plan_step, reach_step
from cell.console import Console
from cell.files.observation import read_observation
from cell.files.task import read_task
from cell.task.explain import _may_stand
from cell.task.planning import Rest, request_of
from plan.advice.changes import MoveBodies, groups_of

SLAB = """
[[walls]]
name = "slab"
centre_mm = [520, -60, 230]
size_mm = [60, 60, 20]
"""


@pytest.fixture
def scenes(planned_scenes: Path, tmp_path: Path) -> Path:
    """A copy of the shipped scenes with their look, which a test may change."""
    return Path(shutil.copytree(planned_scenes, tmp_path / "scenes"))


@pytest.fixture
def blocked(scenes: Path) -> Path:
    """The scenes with a slab above hole 03-04/4, put there after the look, which it would hide the hole from."""
    cell = scenes / "cell.toml"
    cell.write_text(cell.read_text() + SLAB)
    return scenes


def refusal(scenes: Path, advice: bool) -> ImpossibleError:
    task, look = scenes / "task2.toml", scenes / "look.json"
    with pytest.raises(ImpossibleError) as caught:
        plan_step(task, look, scenes / "plan.json", None, Console(True), advice)
    return caught.value


@pytest.mark.slow
def test_a_refused_plan_shows_what_rejects_each_way_and_advice_that_holds(
    blocked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    error = refusal(blocked, advice=True)
    told = capsys.readouterr()
    assert told.out == ""
    assert "line blocked: line at 03-04/4" in told.err
    assert "gripper is inside slab (required: 5 mm)" in told.err
    body: dict[str, Any] = json.loads(json.dumps(error.data))
    assert body["failure"]["body"] == "slab"
    first = body["advice"][0]
    assert first["text"] in told.err
    assert first["what"] == "slab"
    # done as it says, the plan comes out, and takes as long as was said
    cell = blocked / "cell.toml"
    x, y, z = np.array([520.0, -60.0, 230.0]) + first["by_mm"]
    cell.write_text(cell.read_text().replace("[520, -60, 230]", f"[{x:.1f}, {y:.1f}, {z:.1f}]"))
    plan = plan_step(
        blocked / "task2.toml", blocked / "look.json", blocked / "plan.json", None, Console(True)
    )
    assert plan["motion_s"] == pytest.approx(first["motion_s"], abs=0.5)


def test_without_advice_the_refusal_is_quick_and_still_explained(
    blocked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    error = refusal(blocked, advice=False)
    told = capsys.readouterr().err
    assert "slab" in told
    assert "what would help" not in told
    assert error.data["advice"] == []


def test_a_start_in_the_table_names_the_keys_of_the_cell_file(scenes: Path) -> None:
    cell = scenes / "cell.toml"
    start = "q_start_deg = [-60, -85, -80, 0, -60, 0]"
    cell.write_text(cell.read_text().replace("q_start_deg = [-60, -40, -80, 0, -60, 0]", start))
    told = str(refusal(scenes, advice=False))
    assert "is inside table (required: 10 mm)" in told
    assert told.endswith(f"in cell.toml, {start} or table.top_z_mm = 0 has to change")


def test_a_cage_as_one_box_is_told_as_a_solid_body(scenes: Path) -> None:
    cell = scenes / "cell.toml"
    wall = '\n[[walls]]\nname = "cage"\ncentre_mm = [0, 0, 1000]\nsize_mm = [2000, 2000, 2000]\n'
    cell.write_text(cell.read_text() + wall)
    told = str(refusal(scenes, advice=False))
    assert "in cell.toml, walls[1] (cage): the arm's base is 200 mm inside it" in told
    assert told.endswith("A body is solid: a cage is a wall for each of its sides")


@pytest.mark.parametrize(
    ("q_start", "clearance", "told"),
    [
        ("-60, -40, -80, 0, -60, 0", "60", "lower motion.clearance_mm to 46.6 or less, or change {start}"),
        ("-60, -78, -103, 0, -80, 0", "10", "{start} has to change"),  # the arm is inside itself
    ],
)
def test_a_start_where_the_arm_is_too_near_to_itself_names_no_obstacle(
    scenes: Path, q_start: str, clearance: str, told: str
) -> None:
    cell, start = scenes / "cell.toml", f"q_start_deg = [{q_start}]"
    text = cell.read_text().replace("q_start_deg = [-60, -40, -80, 0, -60, 0]", start)
    cell.write_text(re.sub("(?m)^clearance_mm = [0-9]+", f"clearance_mm = {clearance}", text))
    refused = str(refusal(scenes, advice=False))
    assert "the arm cannot leave its start" in refused
    assert refused.endswith(f"; both are parts of the arm: in cell.toml, {told.format(start=start)}")


def test_holes_out_of_reach_are_explained_by_reach_alone(
    scenes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    world = scenes / "task2.world.toml"
    text = world.read_text().replace("centre_mm = [460, 110, 40]", "centre_mm = [460, 110, 80]")
    text = text.replace("tilt_deg = 7", "tilt_deg = 25")
    world.write_text(text.replace("lean_azimuth_deg = 265", "lean_azimuth_deg = 180"))
    look_step(scenes / "task2.toml", None, None, scenes / "look.json", None, Console(True))
    with pytest.raises(ImpossibleError) as caught:
        reach_step(scenes / "task2.toml", scenes / "look.json", Console(True))
    told = capsys.readouterr().err
    assert caught.value.data["failure"]["kind"] == "out of reach"
    assert "joint J3 goes" in told
    assert "out of reach: line at 01-02/2" in told


@pytest.mark.slow
def test_boards_outside_the_zone_are_told_before_anything_is_planned(
    blocked: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = blocked / "cell.toml"
    cell.write_text(
        cell.read_text().replace("zone_size_mm = [440, 540, 216]", "zone_size_mm = [440, 300, 216]")
    )
    look_step(blocked / "task2.toml", None, None, None, None, Console(True))
    assert capsys.readouterr().err.count("NOTE: boards were seen outside the zone for boards") == 1
    reach_step(blocked / "task2.toml", blocked / "look.json", Console(True))
    assert capsys.readouterr().err.startswith("NOTE: boards were seen outside the zone for boards")
    refusal(blocked, advice=False)
    assert capsys.readouterr().err.startswith("NOTE: boards were seen outside the zone for boards")


def test_a_board_may_stand_in_the_zone_where_the_camera_sees_its_markers(scenes: Path) -> None:
    task = read_task(scenes / "task2.toml")
    seen = read_observation(scenes / "look.json", task.cell)
    request = request_of(Rest(task, seen, task.cell.q_start, 0.5))
    group = groups_of(request.scene, request.stations())["board 01-02"]

    def may(*by: float) -> bool:
        change = MoveBodies("", "board 01-02", group, by)
        return _may_stand(task, seen, request, change.apply(request))

    assert may(0.0, 0.0, 0.0)
    assert may(0.0, -0.1, 0.0)
    assert not may(0.0, 0.2, 0.0)  # out of the zone
    assert not may(-0.1, 0.0, 0.0)  # in the zone, out of the image
