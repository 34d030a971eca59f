"""What a plan tells of the tool's speed on a path is what the tool does there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from cell.program import path_speeds as path_speeds_module
from cell.program.path_speeds import KeptSpeed, path_speeds
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


STEADY = (
    PROGRAM.replace('line_of = "wire.toml"\nbackwards = true\n', "")
    .replace(
        "extend_mm = [60, -30]",
        "points_mm = {points}\ndeviation_mm = {deviation}\nspeed_mm_s = {speed}\nsteady = true",
    )
    .replace('axis = "along"', "axis = [0, 0, 1]")
    .replace('touch = [["ring", "bar"]]\n', "")
)
BEND = [[0, -150, 260], [0, -150, 160], [120, -150, 160]]


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "lowered"), [(20, False), (400, True)])
def test_one_speed_is_kept_from_run_up_to_run_out(tmp_path: Path, speed: float, lowered: bool) -> None:
    task = read_program(program(tmp_path, STEADY.format(points=BEND, deviation=20, speed=speed)))
    plan = plan_of_program(task, Observation(), 0.5)
    (said,) = (KeptSpeed.from_json(one) for one in plan.task["kept_speeds"])
    assert (said.speed < 0.95e-3 * speed) is lowered
    move = next(move for move in plan.moves if move.name == said.move)
    q = task.cell.unit.positions(move.path.sample(0.004))
    at = np.array([task.cell.robot().T_base_tool(some)[:3, 3] for some in q])
    steps = np.linalg.norm(np.diff(at, axis=0), axis=1)
    done = np.cumsum(steps)
    between = (done > said.run_up + 1e-3) & (done < done[-1] - said.run_out - 1e-3)
    assert between.sum() > 20
    assert np.abs(steps[between] / 0.004 / said.speed - 1.0).max() < 0.06
    assert lowered or said.run_up + said.run_out < 0.3 * done[-1]


@pytest.mark.slow
def test_a_path_that_slows_the_tool_at_any_speed_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(path_speeds_module, "_BETTER", 2.0)  # as if no lower speed were any better
    task = read_program(program(tmp_path, STEADY.format(points=BEND, deviation=0.2, speed=200)))
    with pytest.raises(
        ImpossibleError, match=r"path 'wire': the tool keeps no speed: at .* mm/s it slows down to"
    ):
        plan_of_program(task, Observation(), 0.5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("speed_mm_s = 20\n", "", r"steps\[1\].steady = True: needs speed_mm_s"),
        (
            "axis = [0, 0, 1]",
            'axis = "along"',
            r"steps\[1\].steady = True: needs a direction x, y, z as axis",
        ),
        ("deviation_mm = 20\n", "", r"needs a path without stops: the arm stops at the corner 100 mm after"),
    ],
)
def test_one_speed_needs_a_speed_a_direction_and_no_stop(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    text = STEADY.format(points=BEND, deviation=20, speed=20)
    with pytest.raises(InputError, match=words):
        read_program(program(tmp_path, text.replace(old, new)))
