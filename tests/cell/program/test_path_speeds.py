"""What a plan tells of the tool's speed on a path is what the tool does there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cell.program.path_speeds import path_speeds
from cell.program.planning import plan_of_program
from cell.program.program_file import read_program
from programs.program_files import PROGRAM, program
from vision.observation import Observation

# into the wire and out of it again, so that no transit begins on it
OPEN = PROGRAM.replace("backwards = true", "backwards = true\nback = true\nspeed_mm_s = {speed}")


@pytest.mark.slow
@pytest.mark.parametrize(("asked", "reached"), [(15.0, True), (1500.0, False)])
def test_a_speed_that_the_joints_allow_is_reached_and_another_is_told(
    tmp_path: Path, asked: float, reached: bool
) -> None:
    task = read_program(program(tmp_path, OPEN.format(speed=asked)))
    plan = plan_of_program(task, Observation(), 0.5)
    speeds = path_speeds(task, plan)
    assert [one.move for one in speeds] == ["along wire", "back along wire"]
    moves = {move.name: move for move in plan.moves}
    for one in speeds:
        q = task.cell.unit.positions(moves[one.move].path.sample(0.004))
        at = np.array([task.cell.robot().T_base_tool(some)[:3, 3] for some in q])
        steps = np.linalg.norm(np.diff(at, axis=0), axis=1)
        below = steps[steps / 0.004 < one.median].sum() / steps.sum()
        assert 0.3 < below < 0.7
        assert steps.max() / 0.004 < 1.02e-3 * asked
        assert (one.median > 0.85e-3 * asked) is reached
        assert (one.share > 0.0) is reached
