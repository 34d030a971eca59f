"""The page of a plan of a calibrated cell: both clearances of every move, and the accuracy of its placements."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.plan_file import Plan
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.plan_budgets import plan_budgets
from cell.files.task import Task, read_task
from cell.preview.of_plan import plan_page
from cell.task.planning import Rest, plan_rest
from tasks.true_look import true_look
from vision.observation import Observation


@pytest.fixture(scope="module")
def real() -> tuple[Task, Observation, Plan]:
    task = read_task(data_file("scenes/realistic/task2.toml"))
    seen = true_look(task).with_states({"01-02/3": "empty", "01-02/4": "empty"})
    plan = plan_rest(Rest(task, seen, task.cell.q_start, 0.5))
    assert plan is not None
    return task, seen, plan


def _moves(text: str) -> list[dict[str, Any]]:
    found = re.search(r'<script id="content" type="application/json">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    return [step for step in json.loads(found[1])["steps"] if step["kind"] == "move"]


def test_every_move_has_both_clearances(real: tuple[Task, Observation, Plan]) -> None:
    task, _, plan = real
    moves = _moves(plan_page(task, plan))
    assert [m["clearance"] for m in moves] == [m.clearance for m in plan.moves]
    assert [m["clearance_with_errors"] for m in moves] == list(erring_clearances(task.cell, plan))
    assert all(m["clearance_with_errors"] < m["clearance"] for m in moves)


def test_a_plan_that_keeps_too_little_is_shown_as_it_is(real: tuple[Task, Observation, Plan]) -> None:
    task, _, plan = real
    erring = replace(task, cell=replace(task.cell, following_error=np.radians(0.3)))
    assert min(m["clearance_with_errors"] for m in _moves(plan_page(erring, plan))) < 0.0


def test_without_known_errors_or_of_another_arm_there_is_one_clearance(
    real: tuple[Task, Observation, Plan],
) -> None:
    task, _, plan = real
    for cell, of in (
        (replace(task.cell, calibration=None), plan),
        (task.cell, replace(plan, scene={**plan.scene, "robot_open": "another"})),
    ):
        moves = _moves(plan_page(replace(task, cell=cell), of))
        assert [m["clearance_with_errors"] for m in moves] == [None] * len(moves)


def test_placements_are_shown_over_their_board(real: tuple[Task, Observation, Plan]) -> None:
    task, seen, plan = real
    assert "Predicted accuracy" not in plan_page(task, plan)
    text = plan_page(task, plan, budgets=plan_budgets(task.cell, seen, plan))
    assert text.count("<ellipse") == len(plan.task["cubes"]) == 2
    assert text.count('aria-label="board 03-04"') == 1
    for cube in plan.task["cubes"]:
        assert f'<td class="t">{cube["cube"]}</td><td class="t">{cube["to"]}</td>' in text
