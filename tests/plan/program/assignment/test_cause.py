"""The one cause that stops a task is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.se3 import frozen
from plan.failure import (
    AFTER_TIMING,
    START_BLOCKED,
    TRANSIT_BLOCKED,
    failure_in,
)
from plan.program.assignment.cause import find_cause
from plans.unplannable import advice_that_holds, refused, rng
from tasks.refused import UNIT, at_the_start, narrow, request, slab_above, under_a_lid
from tasks.task2 import Q_START, task2

SEEDS = (0, pytest.param(1, marks=pytest.mark.slow))


def test_a_joint_that_goes_beyond_its_limit_is_named_with_degrees() -> None:
    """With that much more of the joint the way reaches, with a little less it does not."""
    limits = narrow(UNIT.limits(), [-180, -60, -110, -180, -105, -180], [180, 90, 110, 180, 105, 180])
    asked = request(task2(cubes=1), limits)
    _, failure = refused(asked)
    near = next(w for w in failure.ways if w.excess_deg is not None)
    assert near.joint is not None
    joint = asked.scene.robot_open.joint_names.index(near.joint)

    def serves(more_deg: float) -> bool:
        lower, upper = limits.lower.copy(), limits.upper.copy()
        lower[joint] -= np.radians(more_deg)
        upper[joint] += np.radians(more_deg)
        wider = replace(asked, limits=replace(limits, lower=frozen(lower), upper=frozen(upper)))
        table = wider.reach(wider.stations())
        hole = table[near.where.removeprefix("line at ")]
        return any((c.yaw, c.branch, c.ok) == (near.yaw, near.branch, True) for c in hole.choices)

    assert near.excess_deg is not None
    assert serves(near.excess_deg + 1e-6)
    assert not serves(near.excess_deg - 1e-3)


def test_blocked_and_unreachable_candidates_are_listed_together() -> None:
    limits = narrow(UNIT.limits(), [-180, -95, -105, -30, -95, -90], [180, 95, 105, 30, 0, 90])
    asked = request(task2([slab_above(rng(1))], cubes=1), limits)
    _, failure = refused(asked)
    kinds = ["pair" if w.pair else "joint" if w.joint else "outside" for w in failure.ways]
    assert kinds[:2] == ["pair", "pair"]
    assert set(kinds[2:]) == {"joint"}
    assert len(kinds) == 32
    assert "all 2 grasps in reach are blocked" in failure.headline


@pytest.mark.parametrize("seed", SEEDS)
def test_a_start_beside_a_crate_is_named(seed: int) -> None:
    tool = task2().scene.robot_open.T_base_tool(Q_START)
    asked = request(task2([at_the_start(rng(seed), tool)], cubes=1))
    error, failure = refused(asked)
    assert (failure.kind, failure.body, failure.stations) == (START_BLOCKED, "crate", ())
    assert failure.ways[0].distance_mm is not None
    assert 0.0 < failure.ways[0].distance_mm < 5.0
    if seed != SEEDS[0]:
        return
    found = advice_that_holds(asked, error)
    assert [a.to_json()["change"] for a in found] == ["move", "take away"]


@pytest.mark.slow
def test_walls_all_round_are_no_way_across() -> None:
    asked = under_a_lid()
    error, failure = refused(asked)
    assert failure.kind == TRANSIT_BLOCKED
    assert failure.step == "from the start to 01-02/1"
    assert failure.body == "wall e"
    assert failure.ways[0].distance_mm is not None
    assert failure.ways[0].distance_mm < 11.0
    found = advice_that_holds(asked, error, budget=3)
    assert "take wall e away" in [a.change.text for a in found]


def test_a_clearance_lost_to_timing_names_step_and_pair() -> None:
    task = task2(cubes=1)
    asked = request(task)
    why = ImpossibleError(
        "step 'cube 1: home': palm comes within 7.00 mm of wall", step="cube 1: home", pair=["palm", "wall"],
        distance_m=0.007, proved_m=0.0065, clearance_m=0.01, time_s=1.0,
    )  # fmt: skip
    table = asked.reach(asked.stations())
    error = find_cause(why, task.scene, task.transfers, Q_START, asked.options, table)
    failure = failure_in(error)
    assert failure is not None
    assert (failure.kind, failure.step) == (AFTER_TIMING, "cube 1: home")
    assert (failure.ways[0].distance_mm, failure.ways[0].required_mm) == (7.0, 10.0)
    assert error.data["proved_m"] == 0.0065
    unproved = ImpossibleError(str(why), **{**why.data, "distance_m": 0.0101, "proved_m": 0.009996})
    told = find_cause(unproved, task.scene, task.transfers, Q_START, asked.options, table)
    assert "only 9.996 mm between palm and wall are proved (required: 10 mm)" in str(told)
