"""What a search may cost: counted in looks, so that a budget gives the same plan everywhere; a clock only refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.budget import (
    CHECKS_PER_SECOND,
    BudgetSpent,
    Meter,
    PlanningInterrupted,
    SearchBudget,
    allowed,
    spend,
)
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from plan.program.sequence.search import PoseSearch
from tasks.pose_lists import EFFORT, FAST, TABLE, check_plan, down

WALL = Body("wall", Box((0.4, 0.02, 0.3)), transform(t=(0.5, 0.0, 0.15)), "wall")
TARGETS = [
    Target("a", down(0.45, -0.2, 0.1), free="rz"),
    Target("b", down(0.45, 0.2, 0.1), free="rz"),
    Target("c", down(0.4, -0.25, 0.12), free="rz"),
]


def planned(robot: Robot, unit: Unit, budget: SearchBudget | None = None) -> Planned:
    return plan_poses(
        robot, [TABLE, WALL], TARGETS, np.radians([-35, -35, -85, 0, -60, 0]), unit.limits(),
        options=FAST, effort=EFFORT, budget=budget,
    )  # fmt: skip


@pytest.fixture(scope="module")
def free(robot: Robot, crs97: Unit) -> tuple[Planned, float]:
    """The plan without a budget, and what it took, s of effort."""
    with allowed(None) as meter:
        plan = planned(robot, crs97)
    return plan, meter.effort_s


@pytest.mark.slow
def test_a_budget_that_is_enough_changes_nothing(
    robot: Robot, crs97: Unit, free: tuple[Planned, float]
) -> None:
    plan, effort = free
    assert not plan.stopped
    assert effort > 0.5
    for budget in (SearchBudget(effort_s=2.0 * effort), SearchBudget(give_up_s=1000.0)):
        again = planned(robot, crs97, budget)
        assert json.dumps(again.to_json()) == json.dumps(plan.to_json())


def test_where_it_is_spent_the_best_complete_way_is_taken_the_same_each_time(
    robot: Robot, crs97: Unit, free: tuple[Planned, float]
) -> None:
    best, effort = free
    budget = SearchBudget(effort_s=0.5 * effort)
    plans = [planned(robot, crs97, budget) for _ in range(2)]
    assert json.dumps(plans[0].to_json()) == json.dumps(plans[1].to_json())
    plan = plans[0]
    check_plan(plan, TARGETS, crs97.limits())
    assert plan.clearance >= FAST.clearance
    assert all(move.certified for move in plan.moves)
    assert plan.detours < best.detours
    assert plan.duration_s >= plan.lower_bound_s
    assert plan.stopped.startswith(
        f"the budget of {0.5 * effort:g} s of effort is spent: this is a complete plan"
    )
    assert f"none takes less than {plan.lower_bound_s:.1f} s" in plan.stopped
    assert plan.to_json()["stopped"] == plan.stopped


def test_without_a_complete_plan_the_progress_is_reported(robot: Robot, crs97: Unit) -> None:
    with pytest.raises(
        ImpossibleError, match=r"the budget of 0.001 s of effort is spent: no complete plan"
    ) as caught:
        planned(robot, crs97, SearchBudget(effort_s=0.001))
    assert caught.value.exit_code == 3
    assert caught.value.data["budget"] == "effort"
    assert caught.value.data["reached"] == []
    with pytest.raises(
        ImpossibleError, match=r"found as far as a \(1 of 3\)|no path to a was found"
    ) as caught:
        planned(robot, crs97, SearchBudget(effort_s=0.1))
    assert caught.value.data["reached"] + caught.value.data["left"] == ["a", "b", "c"]
    assert 0.1 <= caught.value.data["effort_s"] <= 0.12


def test_a_clock_only_refuses(robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]

    def later() -> float:
        now[0] += 1.0
        return now[0]

    monkeypatch.setattr("plan.budget.time.monotonic", later)
    with pytest.raises(
        ImpossibleError, match=r"given up after 20 s of wall time: no complete plan"
    ) as caught:
        planned(robot, crs97, SearchBudget(effort_s=100.0, give_up_s=20.0))
    assert caught.value.data["budget"] == "clock"


def test_ctrl_c_reports_the_progress(robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch) -> None:
    made = PoseSearch._straight

    def interrupted(self: PoseSearch, prefix, index: int):  # type: ignore[no-untyped-def]
        if prefix.layer == 1:
            raise KeyboardInterrupt
        return made(self, prefix, index)

    monkeypatch.setattr(PoseSearch, "_straight", interrupted)
    with pytest.raises(
        PlanningInterrupted, match=r"interrupted: no complete plan was found; .* as far as a \(1 of 3\)"
    ) as caught:
        planned(robot, crs97)
    assert isinstance(caught.value, KeyboardInterrupt)
    assert caught.value.plan is None


def test_looks_are_counted_against_what_is_allowed() -> None:
    spend(1e12)  # nobody counts
    with allowed(SearchBudget(effort_s=1.0)) as meter:
        spend(0.6 * CHECKS_PER_SECOND)
        with pytest.raises(BudgetSpent), meter.part(0.5):
            spend(0.3 * CHECKS_PER_SECOND)
        with meter.lifted():
            spend(5.0 * CHECKS_PER_SECOND)
        with allowed(None) as inner:
            assert inner is meter
        with pytest.raises(BudgetSpent, match="budget of 1 s") as caught:
            spend(1.0)
    assert caught.value.effort_s == 5.9
    assert Meter(SearchBudget()).effort_s == 0.0


@pytest.mark.parametrize("wrong", [0.0, -1.0, np.nan, "10", 1e9])
@pytest.mark.parametrize("name", ["effort_s", "give_up_s"])
def test_budgets_are_positive_numbers(name: str, wrong: object) -> None:
    with pytest.raises(InputError, match=f"{name} = "):
        SearchBudget(**{name: wrong})  # type: ignore[arg-type]
