"""A plan is judged anew from its file: whatever was changed in it, the replay finds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from arm.bodies import Body, Box
from arm.errors import ImpossibleError
from arm.motion import CountPath, Segment
from arm.planfile import GripperStep, Move, Plan, Step
from arm.se3 import transform
from arm.unit import load_unit
from plan.replay import Asked, replay
from plan.scene import Scene, scene_from_json
from plan.task import plan_task
from task2_scene import Q_START, Task2, task2

UNIT = load_unit("crs93")
LIMITS = UNIT.limits()


@pytest.fixture(scope="module")
def case() -> Task2:
    return task2()


@pytest.fixture(scope="module")
def plan(case: Task2) -> Plan:
    return plan_task(case.scene, case.transfers[:1], Q_START, UNIT)


@pytest.fixture(scope="module")
def scene(case: Task2, plan: Plan) -> Scene:
    return scene_from_json(plan.scene, case.scene.robot_open, case.scene.robot_holding)


def _changed(plan: Plan, role: str, change: Callable[[Move], Move], last: bool = False) -> Plan:
    indices = [i for i, s in enumerate(plan.steps) if isinstance(s, Move) and s.role == role]
    index = indices[-1 if last else 0]
    steps = list(plan.steps)
    move = steps[index]
    assert isinstance(move, Move)
    steps[index] = change(move)
    return replace(plan, steps=tuple(steps))


def _faster(move: Move) -> Move:
    segments = tuple(Segment(max(1, s.duration_ms * 8 // 10), s.coefficients) for s in move.path.segments)
    return replace(move, path=CountPath(move.path.start, segments))


def test_what_was_not_changed_holds(plan: Plan, scene: Scene) -> None:
    assert len(replay(plan, scene, UNIT, LIMITS)) == len(list(plan.moves))


@pytest.mark.parametrize(
    ("role", "change", "message"),
    [
        ("transit", lambda m: replace(m, clearance=m.clearance + 0.004), "the plan states"),
        ("transit", _faster, "over its velocity"),
        ("transit", lambda m: replace(m, held="cube B"), "says that it holds"),
        ("retract", lambda m: replace(m, held=None), "says that it holds nothing"),
        ("retract", lambda m: replace(m, touching=()), "the plan states"),
        ("retract", lambda m: replace(m, touching=("table",)), "does not allow there"),
    ],
)
def test_a_changed_move_is_found(
    plan: Plan, scene: Scene, role: str, change: Callable[[Move], Move], message: str
) -> None:
    with pytest.raises(ImpossibleError, match=message):
        replay(_changed(plan, role, change), scene, UNIT, LIMITS)


ASKED = Asked(clearance=0.010, line_clearance=0.005, offset=0.100)


def test_what_the_cell_asks_for_is_kept_or_told(plan: Plan, scene: Scene) -> None:
    replay(plan, scene, UNIT, LIMITS, ASKED)
    for asked, message in (
        (replace(ASKED, clearance=0.050), "50 mm are asked for"),
        (replace(ASKED, line_clearance=0.050), "50 mm are asked for"),
        (replace(ASKED, offset=0.090), "is no line of 90 mm"),
    ):
        with pytest.raises(ImpossibleError, match=message):
            replay(plan, scene, UNIT, LIMITS, asked)
    unproved = _changed(plan, "home", lambda m: replace(m, certified=False))
    with pytest.raises(ImpossibleError, match="unproved"):
        replay(unproved, scene, UNIT, LIMITS, ASKED)
    bent = _changed(plan, "home", lambda m: replace(m, role="retract"))
    with pytest.raises(ImpossibleError, match="is no line"):
        replay(bent, scene, UNIT, LIMITS, ASKED)


def test_contacts_on_a_transit_are_not_allowed(plan: Plan, scene: Scene) -> None:
    lifted = next(m for m in plan.moves if m.touching)
    with pytest.raises(ImpossibleError, match="does not allow there"):
        replay(
            _changed(plan, "transit", lambda m: replace(m, touching=lifted.touching), last=True),
            scene,
            UNIT,
            LIMITS,
        )


def test_a_missing_grip_is_found(plan: Plan, scene: Scene) -> None:
    steps: list[Step] = [s for s in plan.steps if not (isinstance(s, GripperStep) and s.action == "close")]
    with pytest.raises(ImpossibleError, match="says that it holds"):
        replay(replace(plan, steps=tuple(steps)), scene, UNIT, LIMITS)


def test_a_body_that_is_there_now_is_found(plan: Plan, scene: Scene) -> None:
    transit = next(m for m in plan.moves if m.role == "transit")
    q = UNIT.positions(transit.path.knots()[len(transit.path.segments) // 2])
    tool = scene.robot_open.T_base_tool(q)[:3, 3]
    box = Body("box", Box((0.1, 0.1, 0.05)), transform(t=tool - np.array([0.0, 0.0, 0.03])), "wall")
    with pytest.raises(ImpossibleError, match="box"):
        replay(plan, replace(scene, bodies=(*scene.bodies, box)), UNIT, LIMITS)


def test_lower_limits_are_kept_or_told(plan: Plan, scene: Scene) -> None:
    lower = replace(LIMITS, velocity=LIMITS.velocity * 0.5)
    with pytest.raises(ImpossibleError, match="over its velocity"):
        replay(plan, scene, UNIT, lower)
