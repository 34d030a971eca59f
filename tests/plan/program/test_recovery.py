"""Motions from where a run could not go on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box
from arm.se3 import inverse, transform
from plan.cartesian.reachability import reach
from plan.options import PlanOptions
from plan.program.recovery import plan_retreat
from plan.trajectory.extremes import segment_extremes
from tasks.task2 import JAW_OPENING, Task2, task2

UNIT = load_unit("crs93")

OPTIONS = PlanOptions()


@pytest.fixture(scope="module")
def case() -> Task2:
    return task2()


@pytest.fixture(scope="module")
def q_place(case: Task2) -> np.ndarray:
    """Where the jaws stand around cube 2."""
    station = case.transfers[1].pick
    table = reach(case.scene.robot_open, UNIT.limits(), {station.name: station.T_base_tool}, OPTIONS.offset)
    return UNIT.positions(UNIT.counts(table[station.name].feasible()[0].q_hole))


def test_straight_out_and_from_rest_to_rest(case: Task2, q_place: np.ndarray) -> None:
    (move,) = plan_retreat(case.scene, q_place, UNIT, UNIT.limits(), OPTIONS)
    assert move.path.start == tuple(UNIT.counts(q_place))
    for velocity in (move.path.segments[0].derivative(0.0), move.path.segments[-1].derivative(1.0)):
        assert np.abs(velocity).max() == 0.0
    place = inverse(case.scene.robot_open.T_base_tool(q_place))
    relative = [place @ case.scene.robot_open.T_base_tool(q) for q in UNIT.positions(move.path.sample(0.01))]
    assert max(np.hypot(T[0, 3], T[1, 3]) for T in relative) < 1e-4
    assert relative[-1][2, 3] == pytest.approx(-OPTIONS.offset, abs=1e-4)
    found, allowed = segment_extremes(move.path, UNIT), UNIT.limits().scaled(OPTIONS.speed)
    assert (found.velocity <= allowed.velocity).all()
    assert (found.acceleration <= allowed.acceleration).all()
    assert move.certified
    assert move.jaw_opening == JAW_OPENING
    assert (move.role, move.held) == ("retract", None)
    assert move.clearance >= 0.0045


def test_an_obstacle_is_named(case: Task2, q_place: np.ndarray) -> None:
    T = case.scene.robot_open.T_base_tool(q_place)
    beside = (T @ transform(t=(0.0, 0.07, -0.17)))[:3, 3]
    box = Body("box", Box((0.05, 0.05, 0.05)), transform(t=beside), "box")
    scene = replace(case.scene, bodies=(*case.scene.bodies, box))
    with pytest.raises(ImpossibleError, match=r"'the place of the jaws'.* from box") as refused:
        plan_retreat(scene, q_place, UNIT, UNIT.limits(), OPTIONS)
    assert "box" in refused.value.data["pair"]
