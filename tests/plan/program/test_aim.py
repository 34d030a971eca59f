"""The largest clearance as an aim."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

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


@dataclass
class Room:
    """Plans that exist where transits and lines have room for what is asked, and may keep more of it by chance."""

    transits: float
    lines: float
    seed: int

    def __post_init__(self) -> None:
        self.asked: list[PlanOptions] = []
        self.made: list[Any] = []
        self.rng = np.random.default_rng(self.seed)

    def __call__(self, options: PlanOptions) -> Planned:
        self.asked.append(options)
        if options.clearance > self.transits or options.line_clearance > self.lines:
            raise ImpossibleError("no room")
        transit, line = (
            self.rng.uniform(*span)
            for span in ((options.clearance, self.transits), (options.line_clearance, self.lines))
        )
        moves = [
            SimpleNamespace(role="transit", clearance=transit),
            SimpleNamespace(role="line", clearance=line),
        ]
        duration = 20.0 + 100.0 * transit
        plan = SimpleNamespace(moves=moves, clearance=min(transit, line), duration_s=duration, skipped=())
        self.made.append(plan)
        return cast(Planned, plan)


@pytest.mark.parametrize("seed", range(20))
def test_every_try_keeps_what_is_required_and_the_best_plan_is_taken(seed: int) -> None:
    """Whatever room there is: what is required is never given up, nor hidden by an end that is too near."""
    rng = np.random.default_rng(seed)
    asked = rng.uniform((0.005, 0.0), 0.03)
    required = replace(FAST, aim="clearance", near_ends=True, clearance=asked[0], line_clearance=asked[1])
    room = Room(*(asked + rng.uniform(0.0, 0.06, 2)), seed=seed)
    best = cast(Any, clearest(room, required))
    assert all(options.clearance >= asked[0] and options.line_clearance >= asked[1] for options in room.asked)
    assert [options.near_ends for options in room.asked] == [True] + [False] * (len(room.asked) - 1)
    common = max(min(room.transits, room.lines), min(asked))
    assert best.clearance == pytest.approx(common, abs=max(6e-4, 0.06 * common))
    assert best.clearance == max(made.clearance for made in room.made)
    in_haste = Room(room.transits, room.lines, seed)
    best = cast(Any, clearest(in_haste, replace(required, clearance_worth=1.0)))
    assert best.duration_s == min(made.duration_s for made in in_haste.made)
