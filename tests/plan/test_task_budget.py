"""A task's search that is stopped: by a budget, the same plan each time; by Ctrl-C, the best that was complete."""

from __future__ import annotations

from dataclasses import replace

import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError
from arm.plan_file import Plan
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.budget import BudgetSpent, PlanningInterrupted, SearchBudget, allowed
from plan.options import PlanOptions
from plan.program.assignment import search as sequence
from plan.program.tasks import plan_task
from plans.interrupted import stop_when_complete
from tasks.task2 import Q_START, Task2

POST = Body("pillar", Box((0.1, 0.02, 0.2)), transform(t=(0.6, 0.0, 0.1)), "wall")
STATED = {"notes": {"kept": "yes"}}


def planned(case: Task2, budget: SearchBudget | None = None) -> Plan:
    """Task 2 around a post between the boards."""
    scene = replace(case.scene, bodies=(*case.scene.bodies, POST))
    return plan_task(
        scene, case.transfers, Q_START, load_unit("crs93"), options=PlanOptions(look="never"),
        provenance=STATED, budget=budget,
    )  # fmt: skip


@pytest.fixture(scope="module")
def free(case: Task2) -> tuple[Plan, float]:
    with allowed(None) as meter:
        plan = planned(case)
    return plan, meter.effort_s


@pytest.mark.slow
def test_a_budget_stops_at_the_best_complete_sequence(case: Task2, free: tuple[Plan, float]) -> None:
    best, effort = free
    assert "search" not in best.notes
    assert planned(case, SearchBudget(3.0 * effort, 1000.0)).sha256 == best.sha256
    plans = [planned(case, SearchBudget(round(0.6 * effort, 3))) for _ in range(2)]
    assert plans[0].sha256 == plans[1].sha256
    assert plans[0].duration_s > best.duration_s
    assert all(move.certified and move.clearance >= 0.005 for move in plans[0].moves)
    assert (
        plans[0].notes["search"].startswith(f"the budget of {round(0.6 * effort, 3):g} s of effort is spent")
    )
    assert plans[0].notes["kept"] == "yes"
    assert STATED == {"notes": {"kept": "yes"}}
    # what execution compares says nothing of a budget
    assert plans[0].provenance == best.provenance


def test_too_small_a_budget_is_reported(case: Task2) -> None:
    with pytest.raises(
        ImpossibleError, match=r"budget of 0.2 s of effort is spent: no complete sequence"
    ) as caught:
        planned(case, SearchBudget(0.2))
    assert caught.value.data["budget"] == "effort"
    assert caught.value.data["rejected"]


@pytest.mark.slow
def test_a_clock_refuses_even_what_is_complete(
    case: Task2, free: tuple[Plan, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]

    def later() -> float:
        now[0] += 1.0
        return now[0]

    monkeypatch.setattr("plan.budget.time.monotonic", later)
    with allowed(SearchBudget(give_up_s=1e6)):
        planned(case)
    glances = now[0]
    with pytest.raises(ImpossibleError, match="given up after"):
        planned(case, SearchBudget(give_up_s=glances - 30.0))


def test_a_clock_that_ends_the_search_leaves_nothing_to_time_and_prove(
    case: Task2, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was complete when it ran out differs from machine to machine, so none of it is used."""
    stop_when_complete(monkeypatch, BudgetSpent("clock", 1.0, 2.0))
    with pytest.raises(ImpossibleError, match="given up after 2 s of wall time") as caught:
        planned(case)
    assert caught.value.data["budget"] == "clock"


def test_ctrl_c_has_the_best_complete_plan_with_it(case: Task2, monkeypatch: pytest.MonkeyPatch) -> None:
    stop_when_complete(monkeypatch, KeyboardInterrupt())
    with pytest.raises(
        PlanningInterrupted, match="the search was interrupted: this is the best complete sequence"
    ) as caught:
        planned(case)
    plan = caught.value.plan
    assert isinstance(plan, Plan)
    assert all(move.certified for move in plan.moves)
    assert plan.notes["search"] == str(caught.value)


def test_ctrl_c_before_a_complete_plan_reports_none(case: Task2, monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sequence.TaskSearch, "_checked", pressed)
    with pytest.raises(PlanningInterrupted, match="interrupted: no complete sequence was found") as caught:
        planned(case)
    assert caught.value.plan is None
