"""The gripper of a cell file: everything that moves, plans and draws follows it; what it cannot be is refused."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from arm.plan_file import GripperStep, read_plan, write_plan
from arm.robot.model import load_a465
from cell.config.cell_file import read_cell
from cell.export.scene import surroundings_of_plan
from cell.export.urdf import describe
from cell.files.observation import read_observation
from cell.files.task import read_task
from cell.scene.options import options_of
from cell.scene.places import reach_of
from cell.task.plan_matches import replayed
from cell.task.planning import Rest, plan_rest
from driver.mars.start.startup import gripper_lines
from tasks.small import leave_cubes
from typed.command_line import a465, replace_in

OTHER = """length_mm = 150
jaw_opening_mm = 70
jaw_shut_mm = 4
close_to_mm = 20
force_v = 6
finger_mm = [24, 12, 40]
palm_mm = [60, 90, 35]
body_radius_mm = 36"""


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    return Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes"))


def _other_gripper(scenes: Path) -> None:
    cell = scenes / "cell.toml"
    lines = cell.read_text().splitlines()
    keys = ("length_mm = 134", "jaw_opening_mm", "finger_mm", "palm_mm", "body_radius_mm")
    kept = [line for line in lines if not line.startswith(keys)]
    cell.write_text("\n".join(kept).replace("[tool]", f"[tool]\n{OTHER}") + "\n")


def test_the_shipped_cell_describes_the_shipped_gripper(scenes: Path) -> None:
    cell = read_cell(scenes / "cell.toml")
    assert cell.nominal_robot().digest == load_a465(cell.gripper.length, 0.06).digest
    for line in ("finger_mm = [20, 10, 25.4]", "palm_mm = [50, 84, 30.012]", "body_radius_mm = 32"):
        replace_in(scenes / "cell.toml", line, "")
    assert read_cell(scenes / "cell.toml").robot().digest == cell.robot().digest


@pytest.mark.slow
def test_a_task_is_planned_checked_and_described_with_another_gripper(scenes: Path) -> None:
    leave_cubes(scenes, 1, 3)
    a465("look", scenes / "task2.toml", "-o", scenes / "look.json")
    _other_gripper(scenes)
    task = read_task(scenes / "task2.toml")
    cell, seen = task.cell, read_observation(scenes / "look.json", task.cell)
    assert cell.gripper.width(options_of(task, 0.5).fraction_closed) == pytest.approx(0.02)
    assert all(hole.ok for hole in reach_of(task, seen).holes)
    plan = plan_rest(Rest(task, seen, cell.q_start, 0.5))
    assert plan is not None
    moves = replayed(task, plan)
    assert len(moves) == len(list(plan.moves))
    # the finger tips of this gripper, not of the shipped one, are at grip height above the hole
    down = next(m for m in plan.moves if m.role == "approach")
    tip = cell.robot().T_base_tool(cell.unit.positions(down.path.end))
    name = plan.task["cubes"][0]["from"]
    board = next(b for b in seen.boards if b.name == name.split("/")[0]).pose
    hole = board.T_base_board @ board.board.T_board_hole(int(name.split("/")[1]) - 1)
    assert (np.linalg.inv(hole) @ tip)[:3, 3] == pytest.approx((0.0, 0.0, cell.grip_height), abs=2e-4)
    close = next(s for s in plan.steps if isinstance(s, GripperStep) and s.action == "close")
    assert close.fraction_closed == pytest.approx((70 - 20) / 66)
    # a plan alone tells its gripper to who exports it, and the exported arm has it
    write_plan(scenes / "plan.json", plan)
    there = surroundings_of_plan(scenes / "plan.json", plan, None)
    assert there.robot.digest == cell.robot().digest
    root = ElementTree.fromstring(str(describe(there).files["cell.urdf"]))
    box = root.find("./link[@name='finger_l']/collision/geometry/box")
    assert box is not None
    assert [float(v) for v in box.attrib["size"].split()] == pytest.approx([0.024, 0.012, 0.04])
    said = json.loads((scenes / "plan.json").read_text())["provenance"]["inputs"]["cell"]
    assert said["tool.finger_mm"] == [24.0, 12.0, 40.0]
    assert read_plan(scenes / "plan.json") == plan


def test_the_force_is_a_register_of_the_grippers_axis(scenes: Path) -> None:
    before = read_cell(scenes / "cell.toml").unit
    _other_gripper(scenes)
    unit = read_cell(scenes / "cell.toml").unit
    assert any("REGMEG:10000" in line for line in gripper_lines(before))
    assert any("REGMEG:8000" in line for line in gripper_lines(unit))
    assert (
        unit.digest == before.digest
    )  # counts mean what they did; plans are bound to the force by their inputs


def test_a_urdf_of_ones_own(scenes: Path) -> None:
    _other_gripper(scenes)
    measured = read_cell(scenes / "cell.toml")
    (scenes / "mine.urdf").write_text(measured.gripper.description())
    replace_in(scenes / "cell.toml", "finger_mm = [24, 12, 40]", 'urdf = "mine.urdf"')
    with pytest.raises(InputError, match=r"tool.palm_mm = .*cannot be combined with urdf"):
        read_cell(scenes / "cell.toml")
    for line in ("palm_mm = [60, 90, 35]", "body_radius_mm = 36"):
        replace_in(scenes / "cell.toml", line, "")
    own = read_cell(scenes / "cell.toml")
    assert [(b.name, b.shape) for b in own.robot().bodies] == [
        (b.name, b.shape) for b in measured.robot().bodies
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "length_mm = 150",
            "length_mm = 74",
            r"tool.length_mm = 74: must be at least that of fingers and palm, 75 mm",
        ),
        ("jaw_shut_mm = 4", "jaw_shut_mm = 40", r"tool.jaw_shut_mm = 40: must be less than the cube's 40 mm"),
        (
            "close_to_mm = 20",
            "close_to_mm = 40",
            r"tool.close_to_mm = 40: must be from 4 mm .*cube's 40 mm",
        ),
        ("close_to_mm = 20", "close_to_mm = 3", r"tool.close_to_mm = 3: must be from 4 mm"),
        ("force_v = 6", "force_v = 15", r"tool.force_v = 15: must be a number in V from 0.75 to 11.25"),
        ("finger_mm = [24, 12, 40]", "finger_mm = [24, 12]", r"tool.finger_mm = .*3 numbers in mm"),
        ("palm_mm = [60, 90, 35]", "", r"tool.palm_mm: is missing"),
        ("finger_mm = [24, 12, 40]", 'urdf = "none.urdf"', r"tool.urdf = .*names a file that does not exist"),
    ],
)
def test_what_a_gripper_cannot_be_is_refused(scenes: Path, old: str, new: str, message: str) -> None:
    _other_gripper(scenes)
    replace_in(scenes / "cell.toml", old, new)
    with pytest.raises(InputError, match=message):
        read_cell(scenes / "cell.toml")


def test_another_length_without_a_description_is_refused(scenes: Path) -> None:
    for line in ("finger_mm = [20, 10, 25.4]", "palm_mm = [50, 84, 30.012]", "body_radius_mm = 32"):
        replace_in(scenes / "cell.toml", line, "")
    replace_in(scenes / "cell.toml", "length_mm = 134.112", "length_mm = 134.4")
    with pytest.raises(
        InputError, match=r"tool.length_mm = 134.4: must be 134.112 mm.*finger_mm, palm_mm and body"
    ):
        read_cell(scenes / "cell.toml")
