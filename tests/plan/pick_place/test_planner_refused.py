"""Task 2 refused: holes that cannot be reached, and requests and options that are wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError, InputError
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.options import PlanOptions
from plan.pick_place.planner import plan_task
from plan.scene import Transfer
from tasks.task2 import Q_START, Task2, task2

UNIT = load_unit("crs93")


def test_a_hole_out_of_reach_is_refused_before_anything_is_planned(case: Task2) -> None:
    far = case.transfers[3].place
    T_far = tuple(transform(T[:3, :3], T[:3, 3] + [0.6, 0.0, 0.0]) for T in far.T_base_tool)
    transfers = (*case.transfers[:3], replace(case.transfers[3], place=replace(far, T_base_tool=T_far)))
    with pytest.raises(ImpossibleError, match="out of reach: hole 03-04/4") as caught:
        plan_task(case.scene, transfers, Q_START, UNIT)
    assert caught.value.data["holes"][0]["hole"] == "03-04/4"
    assert caught.value.data["holes"][0]["outside_mm"] > 50.0


def test_a_blocked_hole_is_named_with_what_blocks_it(case: Task2) -> None:
    over_hole = Body(
        "crate",
        Box((0.03, 0.03, 0.02)),
        transform(t=case.transfers[1].pick.T_base_tool[0][:3, 3] + [0, 0, 0.08]),
        "wall",
    )
    blocked = task2(extra=[over_hole])
    with pytest.raises(ImpossibleError, match=r"01-02/2.* is inside crate") as caught:
        plan_task(blocked.scene, blocked.transfers, Q_START, UNIT)
    blocking = [e for e in caught.value.data["rejected"] if "crate" in e["pair"]]
    assert {e["station"] for e in blocking if "station" in e} == {"01-02/2"}


def test_wrong_requests_are_refused(case: Task2) -> None:
    with pytest.raises(InputError, match="at least one cube"):
        plan_task(case.scene, (), Q_START, UNIT)
    with pytest.raises(InputError, match="must be a cube of the scene"):
        plan_task(case.scene, (replace(case.transfers[0], cube="cube 7"),), Q_START, UNIT)
    with pytest.raises(InputError, match=r"joint J2 = 120\.00 deg: must be from"):
        plan_task(case.scene, case.transfers, np.radians([0, 120, 0, 0, 0, 0]), UNIT)
    elsewhere = Transfer("cube 1", case.transfers[1].pick, case.transfers[0].place)
    with pytest.raises(InputError, match=r"cube 'cube 1' stands \d+ mm from the tool at 01-02/2"):
        plan_task(case.scene, (elsewhere,), Q_START, UNIT)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("speed", 1.5, "speed = 1.5: must be from 0.001 to 1"),
        ("clearance", 0.004, "clearance = 0.004 m: must be from 0.005 to 1"),
        ("look", "often", "look = 'often': must be one of each, never"),
        ("segment_ms", 10, "segment_ms = 10 ms: must be from 40 to 2000"),
    ],
)
def test_wrong_options_are_refused(key: str, value: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        PlanOptions(**{key: value})  # type: ignore[arg-type]
