"""The pallet of scenes: one file, each of its 32 places once, in order."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.plan_file import GripperStep
from arm.se3 import inverse
from cell.program.planning import plan_of_program
from cell.program.program_file import read_program
from cell.task.plan_matches import replayed
from vision.observation import Observation

pytestmark = pytest.mark.slow


def test_every_place_of_the_pallet_is_filled_once_in_order() -> None:
    file = data_file("scenes/pallet.toml")
    assert len(file.read_text().splitlines()) <= 30
    task = read_program(file)
    plan = plan_of_program(task, Observation(), 1.0)
    replayed(task, plan)
    robot, T_work_base = task.cell.robot(), inverse(task.T_on_work)
    reached = {r["name"]: T_work_base @ robot.T_base_tool(np.array(r["q"])) for r in plan.task["reached"]}
    names = ["put", *(f"put ({k})" for k in range(2, 33))]
    assert [name for name in reached if name.startswith("put")] == names
    places = [(55 * i, 60 * j, 60 + 45 * k) for k in range(2) for j in range(4) for i in range(4)]
    np.testing.assert_allclose([1e3 * reached[name][:3, 3] for name in names], places, atol=0.1)
    jaws = [step.action for step in plan.steps if isinstance(step, GripperStep)]
    assert jaws == ["close", "open"] * 32
