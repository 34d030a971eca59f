"""Why a list of poses, or a step of it, was refused, and what would help."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Cylinder
from arm.se3 import rot_x, transform
from plan.advice.changes import ChangeOptions, MoveBodies, Request
from plan.advice.search import advise
from plan.collision.certificate import ClearanceCertificate
from plan.collision.world import World
from plan.failure import LINE_BLOCKED, OUT_OF_REACH, START_BLOCKED, Failure, failure_in
from plan.program.goals.target import Target
from plan.program.sequence.refusals import (
    below_table,
    end_blocked,
    lean,
    line_blocked,
    miss,
    out_of_hand,
    straight_blocked,
)
from plan.scene import Scene
from plan.transit.straight import StraightLine
from plans.waypoints import Q_START, planned, refusal_of
from tasks.pose_lists import FAST, TABLE, down


@pytest.mark.slow
def test_a_refused_way_names_the_clearance_that_was_asked_for(robot: Robot, crs97: Unit) -> None:
    cage = [Body("wall", Box((0.9, 0.02, 1.0)), transform(t=(0.58, 0.0, 0.45)), "wall")]
    cage.append(Body("back", Box((0.9, 0.02, 1.0)), transform(t=(-0.58, 0.0, 0.45)), "wall"))
    cage.append(Body("lid", Box((2.0, 2.0, 0.02)), transform(t=(0.0, 0.0, 0.7)), "wall"))
    turned = np.radians([-60, -35, -85, 0, -60, 0])
    with pytest.raises(ImpossibleError, match=r"no path to other side") as caught:
        planned(robot, crs97, [TABLE, *cage], Target("other side", down(0.3, 0.35, 0.2)), q_start=turned)
    assert caught.value.data["clearance_m"] == FAST.clearance
    assert f"(required: {FAST.clearance * 1e3:g} mm)" in str(caught.value)


def test_only_an_arm_with_parallel_axes_keeps_its_tilt(robot: Robot) -> None:
    T = robot.T_base_tool(np.radians([-60, -35, -85, 0, -60, 0]))
    assert lean(robot, T @ transform(rot_x(0.3)), ()) == 0.0


def test_a_goal_below_a_table_is_told_how_far() -> None:
    top = float(TABLE.T_base_body[2, 3]) + TABLE.shape.size[2] / 2.0  # type: ignore[union-attr]
    x, y = TABLE.T_base_body[:2, 3].tolist()
    wall = Body("wall", Box((9.0, 9.0, 9.0)), transform(), "wall")
    assert (
        below_table(np.array([x, y, top - 0.05]), [wall, TABLE]) == ", and it is 50 mm below the top of table"
    )
    for place in ((x, y, top + 1e-3), (x + 5.0, y, top - 0.05)):
        assert below_table(np.array(place), [wall, TABLE]) == ""


WALL = ClearanceCertificate(0.004, 0.004, ("palm", "wall"), 0.25, False, 1)


@pytest.mark.parametrize(
    ("end", "says", "at"), [("from", "starts too near", "a"), ("to", "ends too near", "b")]
)
def test_the_end_of_a_transit_that_is_too_near_is_named(robot: Robot, end: str, says: str, at: str) -> None:
    q_a, q_b = Q_START, Q_START + 0.1
    line = StraightLine(q_a, q_b, 0.01, False, float(end == "to"), end, check=WALL)
    error = end_blocked("a", "b", line, World(robot, []), 0.01)
    assert f"the transit from a to b {says} to a body: at {at}, palm is 4.0 mm from wall" in str(error)
    near = replace(line, check=replace(WALL, clearance=0.00996, seen=0.00996))
    assert "palm is 9.960 mm from wall (required: 10 mm)" in str(
        end_blocked("a", "b", near, World(robot, []), 0.01)
    )
    assert error.data["target"] == at
    assert error.data["at"]["q"] == pytest.approx(q_a if end == "from" else q_b)


def test_a_search_that_was_not_made_is_told_as_such(robot: Robot) -> None:
    world, line = World(robot, []), StraightLine(Q_START, Q_START, 0.01, False, 0.25, check=WALL)
    made, spent = (straight_blocked(line, world, ("a", "b"), 0.01, tried) for tried in (True, False))
    assert str(made).endswith("no detour was found")
    assert str(spent).endswith("the allowed number of detours was used up")
    assert spent.data["reason"] == f"{made.data['reason']}, detour not tried"


def test_the_nearest_miss_lacks_least() -> None:
    """Least clearance where bodies are too near, and least of the way to a body that is out of hand."""
    away = np.random.default_rng(0).uniform(0.0, 0.01, 20)
    near = [line_blocked("line", "b", replace(WALL, seen=float(x)), 0.01, {}) for x in away]
    assert min(near, key=miss).data["distance_m"] == max(away)
    assert miss(near[0]) == pytest.approx(0.01 - away[0])
    target = Target("a", q=Q_START, attach="cup")
    far = [out_of_hand(target, ("palm", "cup"), 0.02 + float(x)) for x in away]
    assert min(far, key=miss).data["distance_m"] == 0.02 + min(away)
    assert miss(far[0]) == pytest.approx(0.02 + away[0] - target.attach_within)


def failure_of(robot: Robot, unit: Unit, bodies: list[Body], *targets: Target) -> Failure:
    failure = failure_in(refusal_of(robot, unit, bodies, *targets))
    assert failure is not None
    return failure


def test_what_is_out_of_reach_says_by_how_much(robot: Robot, crs97: Unit) -> None:
    far = failure_of(robot, crs97, [TABLE], Target("far", down(1.2, 0.0, 0.3)))
    assert (far.kind, far.stations, far.body) == (OUT_OF_REACH, ("far",), None)
    assert far.ways[0].outside_mm is not None
    assert far.ways[0].outside_mm > 100.0


@pytest.mark.slow
def test_what_stands_in_the_way_is_named(robot: Robot, crs97: Unit) -> None:
    post = Body("post", Cylinder(0.03, 0.5), transform(t=(0.42, 0.02, 0.2)), "wall")
    line = failure_of(
        robot, crs97, [TABLE, post],
        Target("a", down(0.42, -0.2, 0.2), free="rz"), Target("b", down(0.42, 0.2, 0.2), by="line", free="rz"),
    )  # fmt: skip
    assert (line.kind, line.stations, line.body) == (LINE_BLOCKED, ("b",), "post")
    at = robot.T_base_tool(np.radians([-60, -35, -85, 0, -60, 0]))
    crate = Body("crate", Box((0.04, 0.04, 0.04)), at, "wall")
    start = failure_of(robot, crs97, [crate], Target("a", down(0.3, 0.35, 0.2)))
    assert (start.kind, start.body) == (START_BLOCKED, "crate")


def test_advice_for_a_list_was_planned(robot: Robot, crs97: Unit) -> None:
    """A box too near to a pose: it helps to move it, or to ask for less clearance where that is what lacks."""
    box = Body("box", Box((0.06, 0.06, 0.2)), transform(t=(0.45, 0.16, 0.05)), "wall")
    goals = (Target("a", down(0.45, 0.1, 0.1), approach=0.05, retract=0.05),)
    options = replace(FAST, line_clearance=0.02, clearance=0.02)
    scene = Scene(robot, robot, (TABLE, box), ())
    request = Request(scene, (), Q_START, crs97, crs97.limits(), options, goals=goals)
    error = refusal_of(robot, crs97, [TABLE, box], *goals, options=options)
    found = advise(request, error)
    assert found
    assert all("all goals can then be planned" in piece.text for piece in found)
    kinds = {type(piece.change) for piece in found}
    assert kinds & {MoveBodies, ChangeOptions}
    for piece in found:
        changed = piece.change.apply(request)
        assert changed.plan() is not None
