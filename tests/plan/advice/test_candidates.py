"""Candidate changes: the least work for the user first."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.advice.changes import Request
from plan.advice.search import advise
from plan.failure import (
    START_BLOCKED,
    TRANSIT_BLOCKED,
    Failure,
    Rejected,
)
from plan.options import PlanOptions
from plans.unplannable import advice_that_holds, refused, rng
from tasks.refused import request, slab_above
from tasks.task2 import Q_START, task2


@pytest.mark.slow
@pytest.mark.parametrize(("gap_mm", "offered"), [pytest.param(23.1, 23, marks=pytest.mark.slow), (12.6, 12)])
def test_the_largest_clearance_that_the_start_keeps_is_offered(gap_mm: float, offered: int) -> None:
    tool = task2().scene.robot_open.T_base_tool(Q_START)
    T = transform(t=tool[:3, 3] + [0.0, 0.0, -0.025 - gap_mm / 1e3])
    crate = Body("crate", Box((0.05, 0.05, 0.05)), T, "wall")
    asked = request(task2([crate], cubes=1), options=PlanOptions(look="never", clearance=0.04))
    error, failure = refused(asked)
    assert failure.kind == START_BLOCKED
    found = advice_that_holds(asked, error, budget=4)
    assert found[0].to_json()["clearance"] == offered / 1e3


def test_a_clearance_is_halved_down_to_where_it_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the largest that plans is, a few plans find it to within a few millimetres, and never above it."""
    asked = request(task2(cubes=1), options=PlanOptions(look="never", clearance=0.04))
    seen = Rejected("from a to b", "near", pair=("palm", "wall"), distance_mm=22.1, required_mm=40.0)
    for where in ("from a to b", "a"):
        for least, most in ((4, 4), (5, 7), (8, 9), (10, 16), (14, 20), (22, 27), (31, 39)):
            failure = Failure(TRANSIT_BLOCKED, "from a to b", (), "no", (replace(seen, where=where),))
            error = ImpossibleError("no", failure=failure.to_json())
            limit = most / 1e3 + 1e-9
            tried: list[float] = []

            def plan(request: Request, limit: float = limit, tried: list[float] = tried) -> SimpleNamespace:
                tried.append(request.options.clearance)
                if request.options.clearance > limit:
                    raise ImpossibleError("too near")
                return SimpleNamespace(duration_s=1.0)

            monkeypatch.setattr(Request, "plan", plan)
            found = [a for a in advise(asked, error, budget=4, wanted=1, groups={}) if "clearance" in a.text]
            assert len(tried) <= 4
            if most < 5:
                assert not found
                continue
            offered = 1e3 * found[0].change.to_json()["clearance"]
            assert least - 1e-6 <= offered <= most + 1e-6


def test_a_cube_is_left_out_last() -> None:
    two = request(task2([slab_above(rng(0))], cubes=2))
    error, _ = refused(two)
    only = advise(two, error, groups={}, fits=lambda r: len(r.scene.bodies) < 1)
    assert [(a.change.text, a.left, a.whole) for a in only] == [("leave cube 1 out", 1, False)]
