"""``--speed`` means the same share of the registers in every command; what is executed is what was asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from arm.plan_file import Plan
from cell.commands.run import execute_plan, run_task
from cell.console import Console
from cell.files.task import Task, read_task
from cell.session.connection import WhichCell
from cell.session.overview import overview
from cell.session.speed import LEAST_SPEED, override_of, planning_speed, tool_words
from cell.task.planning import Rest, plan_rest
from tasks.true_look import true_look

WRONG = (1e-300, 0.0, -0.5, LEAST_SPEED / 2.0, 1.5, float("nan"), float("inf"))


@pytest.fixture(scope="module")
def task() -> Task:
    return read_task(data_file("scenes/task2.toml"))


@pytest.fixture(scope="module")
def plans(task: Task) -> dict[float, Plan]:
    """One cube at two speeds."""
    one = true_look(task).with_states(dict.fromkeys(("01-02/2", "01-02/3", "01-02/4"), "empty"))
    made = {s: plan_rest(Rest(task, one, task.cell.q_start, s)) for s in (0.5, 0.1)}
    return {s: plan for s, plan in made.items() if plan is not None}


def test_a_tenth_is_as_fast_in_a_plan_as_in_the_execution_of_a_faster_one(
    task: Task, plans: dict[float, Plan]
) -> None:
    assert override_of(plans[0.5], 0.1) == pytest.approx(0.2)
    assert override_of(plans[0.1], 0.1) == 1.0
    assert override_of(plans[0.5], None) == 1.0
    robot, unit = task.cell.robot(), task.cell.unit
    fast, slow = (overview(plans[s], robot, unit) for s in (0.5, 0.1))
    allowed = task.cell.limits.velocity
    lowered = (0.2 * fast.fastest / allowed).max()
    planned = (slow.fastest / allowed).max()
    assert planned == pytest.approx(lowered, rel=0.1)  # the same share of the registers
    assert planned <= 0.1
    told = tool_words(plans[0.5], task.cell.robot_holding(), task.cell.unit, 0.2)
    assert told == f"the tool at most {200 * overview(plans[0.5], task.cell.robot(0.04), unit).tool:.0f} mm/s"


@pytest.mark.parametrize("asked", WRONG)
def test_what_is_no_speed_is_refused_with_option_value_and_rule(
    task: Task, plans: dict[float, Plan], asked: float
) -> None:
    for refuse in (lambda: planning_speed(task.cell, asked), lambda: override_of(plans[0.5], asked)):
        with pytest.raises(InputError, match="--speed") as refused:
            refuse()
        assert "must be from 0.01 to" in str(refused.value)


def test_a_speed_in_percent_is_told(task: Task, plans: dict[float, Plan]) -> None:
    for refuse in (lambda: planning_speed(task.cell, 30.0), lambda: override_of(plans[0.5], 30.0)):
        with pytest.raises(InputError, match=r"it is a fraction: 30 % are 0\.3$"):
            refuse()


def test_an_execution_only_lowers(plans: dict[float, Plan]) -> None:
    with pytest.raises(InputError, match=r"the plan was made for 0\.5, and execution can only lower it"):
        override_of(plans[0.5], 0.6)
    assert override_of(plans[0.5], 0.5) == 1.0


def test_a_wrong_speed_is_refused_before_anything_is_opened(
    tmp_path: Path, task: Task, plans: dict[float, Plan], capsys: pytest.CaptureFixture[str]
) -> None:
    from arm.plan_file import write_plan

    write_plan(tmp_path / "plan.json", plans[0.5])
    nowhere = WhichCell(port="socket://127.0.0.1:9", images=tmp_path, speed=1e-300)
    for begin in (
        lambda: run_task(task.file, Console(), nowhere, tmp_path / "run"),
        lambda: execute_plan(tmp_path / "plan.json", task.file, Console(), nowhere, tmp_path / "run"),
    ):
        with pytest.raises(InputError, match="--speed 1e-300"):
            begin()
    assert "homing" not in capsys.readouterr().out
    assert not (tmp_path / "run").exists()


def test_accelerations_go_with_the_square(task: Task) -> None:
    assert np.allclose(task.cell.limits.scaled(0.1).acceleration, 0.01 * task.cell.limits.acceleration)
