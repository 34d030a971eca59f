"""A tool without jaws in a cell file: what moves has it, and nothing asks for jaws."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError, ImpossibleError, InputError
from arm.io.storage import data_file
from arm.plan_file import read_plan, write_plan
from arm.robot.shapes import Cylinder
from arm.se3 import transform
from cell.accuracy.arm_errors import _tool_length
from cell.config.cell_file import read_cell
from cell.config.fixed_tool import fixed_tool_of_inputs
from cell.config.inputs import changes
from cell.export.scene import surroundings_of_plan
from cell.files.task import read_place
from cell.task.plan_matches import replayed, require_match
from driver.mars.start.startup import gripper_lines
from programs.tool_cells import tool_cell
from tasks.pose_list_files import planned, written
from typed.command_line import a465, replace_in

T_FLANGE_RING = transform(np.diag([-1.0, 1.0, -1.0]), (-0.135, 0.0, 0.013))


def test_the_cell_has_the_tool_of_its_file(tmp_path: Path) -> None:
    cell = read_cell(tool_cell(tmp_path))
    np.testing.assert_allclose(cell.tool.T_flange_tool, T_FLANGE_RING, atol=1e-12)
    robot = cell.robot()
    ring = next(b for b in robot.bodies if b.name == "ring")
    assert ring.shape == Cylinder(0.0348, 0.0066)
    assert {b.name: b.padding for b in robot.bodies} == {
        b.name: 0.0 if b.name in ("ring", "handle") else cell.arm_padding for b in robot.bodies
    }
    assert cell.robot_holding().digest == robot.digest
    assert gripper_lines(cell.unit) == []
    assert cell.arm_shape().endswith("the tool is not")
    ring_edge = np.hypot(0.135 + 0.0348, 0.013)  # of the furthest point, in the ring's middle plane
    assert _tool_length(cell) == pytest.approx(ring_edge, abs=0.002)


def test_a_plan_states_its_tool(tmp_path: Path) -> None:
    """Whoever exports a plan alone has the tool; a change of the tool file is named key by key."""
    file = tool_cell(tmp_path)
    place = read_place(file)
    plan = planned(written(tmp_path, [{"q_deg": [-30, -20, -90, 0, -60, 10]}]), place=file)
    assert len(replayed(place, plan)) == 1
    write_plan(tmp_path / "plan.json", plan)
    there = surroundings_of_plan(tmp_path / "plan.json", read_plan(tmp_path / "plan.json"), None)
    assert there.robot.digest == place.cell.robot().digest
    tool = fixed_tool_of_inputs(plan.provenance["inputs"]["cell"])
    assert tool is not None
    assert np.array_equal(tool.T_flange_tool, place.cell.tool.T_flange_tool)
    replace_in(file.with_name("tool.toml"), "radius_mm = 34.8", "radius_mm = 35")
    now = read_place(file)
    assert changes(place.cell.inputs, now.cell.inputs) == ["tool.bodies[ring].radius_mm 34.8, now 35"]
    with pytest.raises(ImpossibleError, match=r"tool.bodies\[ring\].radius_mm 34.8, now 35"):
        require_match(now, plan)


def test_commands_take_a_cell_without_jaws(tmp_path: Path) -> None:
    file = tool_cell(tmp_path)
    poses = written(tmp_path, [{"q_deg": [-30, -20, -90, 0, -60, 10]}])
    plan = tmp_path / "plan.json"
    said, _ = a465("plan", file, poses, "-o", plan, "--json")
    assert json.loads(said)["min_clearance_mm"] >= 10.0
    a465("check", plan, file)
    a465("preview", plan, file, "-o", tmp_path / "page.html")
    assert '"ring"' in (tmp_path / "page.html").read_text()
    a465("export", plan, "--format", "urdf", "-o", tmp_path / "exported")
    a465("check", file, "--q=-60,-40,-80,0,-60,0")


def test_what_asks_for_jaws_is_refused_in_one_line(tmp_path: Path) -> None:
    file = tool_cell(tmp_path)
    jaws = written(tmp_path, [{"q_deg": [-30, -20, -90, 0, -60, 10], "jaws": "close"}])
    _, told = a465("plan", file, jaws, "-o", tmp_path / "p", code=2)
    assert "[0]: jaws: the arm of cell has no jaws that move; leave it out" in told
    _, told = a465("run", file.with_name("task2.toml"), code=2)
    assert "cell = 'cell.toml': names a cell whose tool has no jaws (its tool.bodies)" in told
    with pytest.raises(InputError, match=r"cell.toml: tool.bodies: the tool of this cell has no jaws"):
        _ = read_cell(file).gripper


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('bodies = "tool.toml"', 'bodies = "none.toml"', r"tool.bodies = .*names a file that does not exist"),
        (
            'bodies = "tool.toml"',
            'bodies = "tool.toml"\njaw_opening_mm = 60',
            r"tool.jaw_opening_mm = 60: belongs to a gripper, and cannot be combined with tool.bodies",
        ),
        (
            'bodies = "tool.toml"',
            'bodies = "tool.toml"\ngrip_height_mm = 15',
            r"tool.grip_height_mm = 15: belongs to a gripper",
        ),
        ('name = "camera post"', 'name = "ring"', r"walls\[0\].name = 'ring': is used twice"),
    ],
)
def test_wrong_cells_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tool_cell(tmp_path)
    replace_in(file, old, new)
    with pytest.raises(FileInputError, match=message):
        read_cell(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "ring"', 'name = "handle"', r"tool.toml: bodies\[1\].name = 'handle': is used twice"),
        ('name = "ring"', 'name = "wrist"', r"already has a body named 'wrist'"),
        (
            "radius_mm = 34.8",
            "radius = 34.8",
            r"tool.toml: bodies\[1\].radius_mm: is missing.*bodies\[1\].radius",
        ),
        (
            "rpy_deg = [180, 0, 180]",
            "rpy_deg = [180, 0]",
            r"tool.toml: rpy_deg = \[180, 0\]: must be 3 numbers",
        ),
        (
            "[-135, 0, 13]",
            "[-0.135, 0, 0.013]",
            r"tool.toml: origin_mm = .*: must be \[0, 0, 0\], or 0.5 mm or more",
        ),
        ("rpy_deg", "yaw_deg", r"tool.toml: yaw_deg.*: is not a known key"),
    ],
)
def test_wrong_tools_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:
    file = tool_cell(tmp_path)
    replace_in(file.with_name("tool.toml"), old, new)
    with pytest.raises(InputError, match=message):
        read_cell(file)


def test_a_cell_with_a_gripper_states_no_other_tool() -> None:
    assert fixed_tool_of_inputs(read_cell(data_file("scenes/cell.toml")).inputs) is None
