"""Steps of a program file: grids of poses, and what happens at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from cell.program.program_file import read_program
from cell.program.steps import Action, PoseStep
from programs.program_files import program
from typed.command_line import replace_in


def test_a_pose_with_a_grid_goes_to_its_next_place_in_each_repeat(tmp_path: Path) -> None:
    file = program(tmp_path)
    replace_in(
        file,
        "dwell_s = 0.5",
        "grid.count = [2, 1, 3]\ngrid.step_mm = [50, 40, 30]",
    )
    task = read_program(file)
    assert task.repeat == 6
    pose = task.steps[0]
    assert isinstance(pose, PoseStep)
    places = [[x, 0, z] for z in (0.3, 0.33, 0.36) for x in (0, 0.05)]
    np.testing.assert_allclose(pose.T_work_tool[:, :3, 3], places, atol=1e-12)


def test_a_step_may_act_after_its_motion_or_without_one(tmp_path: Path) -> None:
    file = program(tmp_path)
    replace_in(file, "[[steps]]\njoints_deg", "[[steps]]\ndwell_s = 2\n\n[[steps]]\njoints_deg")
    steps = read_program(file).steps
    assert [step.name for step in steps] == ["above", "above", "wire", "step 3", "joints 4"]
    assert steps[3] == Action("steps[2]", "step 3", None, 2.0)


@pytest.mark.parametrize("steps", ["[0.05, 0, 0]", "[50, -0.999, 0]"])
def test_steps_of_a_grid_in_metres_are_told_as_such(tmp_path: Path, steps: str) -> None:
    file = program(tmp_path)
    replace_in(file, "dwell_s = 0.5", f"grid.count = [2, 1, 1]\ngrid.step_mm = {steps}")
    with pytest.raises(
        InputError, match=r"steps\[0\].grid.step_mm = .*: must be 0, or 1 mm or more.* 50 mm is 50"
    ):
        read_program(file)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("dwell_s = 0.5", "grid.step_mm = [50, 40, 30]", r"steps\[0\].grid.count: is missing; a grid needs count"),
        ("dwell_s = 0.5", "grid.count = [2, 1, 1]", r"steps\[0\].grid.step_mm: is missing; a grid needs count"),
        ("dwell_s = 0.5", "turn_deg = 5", r"turn_deg = 5: is a key of a step with points_mm .* one has at_mm"),
        ("joints_deg", "approach_mm = 5\njoints_deg", r"approach_mm = 5: .* with at_mm, and this one has joints_deg"),
        ("joints_deg", "Joints_deg", r"Joints_deg = .*: is not a known key .did you mean joints_deg"),
        ("dwell_s = 0.5", 'touch = ["ring", "block"]', r'must be pairs of names .* one pair: \[\["ring", "block"\]\]'),
        ("joints_deg", "q_deg", r"q_deg = .*: is not a known key .did you mean joints_deg"),
        ("joints_deg", "joints_rad", r"joints_rad = .*: is not a known key .did you mean joints_deg"),
        ("joints_deg", "sleep_s = 1\njoint", r"sleep_s = 1: is not a known key .did you mean dwell_s"),
        ("joints_deg", "zz", r"zz = .*: is not a known key .a step has one of points_mm, line_of, svg"),
        ("dwell_s = 0.5", 'touch = "ring"', r"touch = 'ring': must be pairs of names of bodies, such as"),
        ('free = "rz"', 'free = ["rz", "x"]', r'must be a string with names of directions .free = "rz, x"'),
    ],
)  # fmt: skip
def test_keys_of_another_kind_of_step_and_halves_of_a_grid_are_told(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    file = program(tmp_path)
    replace_in(file, old, new)
    with pytest.raises(InputError, match=message):
        read_program(file)
