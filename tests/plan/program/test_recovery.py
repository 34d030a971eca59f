"""The way of a cube that a stop left in the jaws: it keeps what its ends leave, and never less than asked."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box
from arm.se3 import Array, inverse, transform
from plan.cartesian.reachability import reach
from plan.collision.search_margin import MARGIN
from plan.options import PlanOptions
from plan.program.recovery import _Carry, plan_retreat
from plan.trajectory.extremes import segment_extremes
from tasks.task2 import JAW_OPENING, Task2, task2

ASKED = PlanOptions().clearance


class _Room:
    """A world in which each end (named by its first joint) keeps a distance."""

    def __init__(self, *distances: float) -> None:
        self.distances = distances

    def distance(self, q: Array) -> Any:
        return SimpleNamespace(value=self.distances[int(q[0])])

    def in_collision(self, q: Array, clearance: float) -> bool:
        return self.distances[int(q[0])] < clearance


@pytest.mark.parametrize(
    ("begins", "ends", "searched"),
    [
        (1.0, 1.0, ASKED + MARGIN),
        (ASKED + MARGIN / 2, 1.0, ASKED + MARGIN / 4),  # where the stop left it
        (1.0, ASKED + MARGIN / 2, ASKED + MARGIN / 4),  # above the place
        (ASKED + MARGIN / 2, ASKED + MARGIN / 8, ASKED + MARGIN / 16),
        (ASKED, 1.0, ASKED),
        (ASKED / 2, 1.0, ASKED),
    ],
)
def test_the_way_of_a_held_cube_is_searched_with_the_margin_that_its_ends_leave(
    monkeypatch: pytest.MonkeyPatch, begins: float, ends: float, searched: float
) -> None:
    """A margin that an end cannot keep would refuse every way from there."""
    asked: list[float] = []

    def plan_transit(world: Any, q_from: Array, q_to: Array, limits: Any, clearance: float, *_: Any) -> Array:
        asked.append(clearance)
        return np.stack([q_from, q_to])

    monkeypatch.setattr("plan.program.recovery.plan_transit", plan_transit)
    carry = _Carry.__new__(_Carry)
    carry.options = PlanOptions()
    carry.planner = SimpleNamespace(planned=None)  # type: ignore[assignment]
    room: Any = _Room(begins, ends)
    carry.across(room, np.zeros(6), np.ones(6))
    assert asked == [pytest.approx(searched, abs=1e-12)]


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
    with pytest.raises(ImpossibleError, match=r"'back out': .* of box") as refused:
        plan_retreat(scene, q_place, UNIT, UNIT.limits(), OPTIONS)
    assert "box" in refused.value.data["pair"]
