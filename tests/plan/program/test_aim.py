"""The largest clearance as an aim."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.budget import PlanningInterrupted
from plan.options import PlanOptions
from plan.program.aim import clearest
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from tasks.pose_lists import EFFORT, FAST, TABLE, down

WALLS = [
    Body(f"wall {side}", Box((0.4, 0.02, 0.25)), transform(t=(0.45, side * 0.13, 0.08)), "wall")
    for side in (-1, 1)
]


@pytest.fixture(scope="module")
def made(robot: Robot, crs97: Unit) -> dict[str, Planned]:
    """From one pose between two walls to another over them, for time, for clearance, and for both."""
    targets = [Target("a", down(0.4, 0.0, 0.1), free="rz"), Target("b", down(0.42, 0.3, 0.15), free="rz")]
    few = replace(EFFORT, candidates=6, detours=4)

    def planned(options: PlanOptions) -> Planned:
        q = np.radians([-35, -35, -85, 0, -60, 0])
        return plan_poses(
            robot, [TABLE, *WALLS], targets, q, crs97.limits(), unit=crs97, options=options, effort=few
        )

    clear = replace(FAST, aim="clearance")
    return {
        "time": planned(FAST),
        "clearance": planned(clear),
        "both": planned(replace(clear, clearance_worth=20.0)),
    }


def test_a_plan_for_clearance_has_the_most(made: dict[str, Planned]) -> None:
    least = {aim: plan.clearance for aim, plan in made.items()}
    assert least["time"] >= FAST.clearance
    assert least["clearance"] > 2.0 * least["time"]
    assert least["time"] <= least["both"] <= least["clearance"] + 1e-9
    assert made["time"].duration_s <= made["both"].duration_s <= made["clearance"].duration_s + 1e-9


def test_the_plan_is_bound_to_what_was_required(made: dict[str, Planned]) -> None:
    plan = made["clearance"].plan()
    assert plan.provenance["options"]["clearance"] == FAST.clearance
    assert plan.provenance["options"]["aim"] == "clearance"


@pytest.mark.parametrize("change", [{"aim": "speed"}, {"clearance_worth": -1.0}])
def test_wrong_aims(change: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(change))):
        PlanOptions(**change)  # type: ignore[arg-type]


def test_a_budget_that_is_spent_on_the_way_is_told(made: dict[str, Planned]) -> None:
    plans = iter([made["time"], made["clearance"]])

    def plan_with(options: PlanOptions) -> Planned:
        found = next(plans, None)
        if found is None:
            raise ImpossibleError("spent", budget="effort", budget_s=2.0)
        return found

    best = clearest(plan_with, replace(FAST, aim="clearance"))
    assert best.clearance == made["clearance"].clearance
    assert best.stopped.startswith("the budget of 2 s of effort is spent: this is the plan with the largest")


def test_wall_time_refuses_even_if_there_is_a_plan(made: dict[str, Planned]) -> None:
    plans = iter([made["time"]])

    def plan_with(options: PlanOptions) -> Planned:
        found = next(plans, None)
        if found is None:
            raise ImpossibleError("given up", budget="clock", budget_s=2.0)
        return found

    with pytest.raises(ImpossibleError, match="given up"):
        clearest(plan_with, replace(FAST, aim="clearance"))


def test_an_interrupt_on_the_way_leaves_the_best_plan(made: dict[str, Planned]) -> None:
    plans = iter([made["time"], made["clearance"]])

    def plan_with(options: PlanOptions) -> Planned:
        found = next(plans, None)
        if found is None:
            raise PlanningInterrupted("interrupted")
        return found

    with pytest.raises(PlanningInterrupted, match="largest clearance that was found by then") as caught:
        clearest(plan_with, replace(FAST, aim="clearance"))
    plan = caught.value.plan
    assert plan is not None
    assert plan.steps == made["clearance"].plan().steps
    assert plan.notes["search"].startswith("the search was interrupted")


def test_no_cube_stays_where_it_is_for_the_sake_of_clearance(made: dict[str, Planned]) -> None:
    fewer = replace(made["clearance"], skipped=({"cube": "cube 1", "from": "a", "reason": "too near"},))
    best = clearest(
        lambda options: made["time"] if options.clearance <= FAST.clearance else fewer,
        replace(FAST, aim="clearance"),
    )
    assert best.skipped == ()
