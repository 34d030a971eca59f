"""What can be asked of a planned list of poses."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import ImpossibleError
from arm.plan_file import Plan
from arm.robot.model import Robot
from plan.options import PlanOptions
from plan.program.goals.attachments import AttachmentState
from plan.program.goals.target import Target
from plan.program.planned import Planned, joined
from plan.program.program import Program, plan_program
from plans.waypoints import Q_START, planned
from tasks.pose_lists import TABLE
from tasks.task2 import Q_START as HOME
from tasks.task2 import task2


def test_export(row: tuple[Planned, list[Target]]) -> None:
    plan, _ = row
    header, *rows = plan.rows(0.02)
    assert header == ["time_s", "J1", "J2", "J3", "J4", "J5", "J6"]
    assert rows[-1][0] == pytest.approx(plan.duration_s)
    value = json.loads(json.dumps(plan.to_json()))
    # the cubics alone give the same motion
    q, t = [], []
    begin = 0.0
    for step in value["steps"]:
        for segment in step.get("segments", ()):
            c = np.array(segment["coefficients_rad"])
            q.append(c[0] + 0.3 * (c[1] + 0.3 * (c[2] + 0.3 * c[3])))
            t.append(begin + 0.3 * segment["duration_s"])
            begin += segment["duration_s"]
        begin += step.get("dwell_s", 0.0)
    assert begin == pytest.approx(plan.duration_s)
    np.testing.assert_allclose(plan.at(t), q, atol=1e-9)


def test_a_program_that_goes_nowhere_has_no_plan(robot: Robot, crs97: Unit) -> None:
    found = planned(robot, crs97, [TABLE], Target("here", q=Q_START))
    assert found.moves == ()
    with pytest.raises(ImpossibleError, match="nothing moves"):
        found.plan()


ASIDE = np.radians([-50.0, -45.0, -75.0, 5.0, -65.0, 5.0])


@pytest.fixture(scope="module")
def aside() -> Planned:
    """One motion of the arm among boards and cubes."""
    options = PlanOptions(speed=0.4)
    return plan_program(
        Program(task2().scene, (Target("aside", q=ASIDE),), HOME, load_unit("crs93"), options=options)
    )


def test_cubics_are_the_motion_that_is_sent(aside: Planned) -> None:
    """Also of joints whose counts run backwards."""
    unit = aside.unit
    assert len(set(np.sign(unit.counts_per_rad))) == 2
    ((move, durations, c),) = aside.cubics()
    begins = np.cumsum(durations) - durations
    for u in (0.0, 0.3, 1.0):
        at = c[:, 0] + u * (c[:, 1] + u * (c[:, 2] + u * c[:, 3]))
        np.testing.assert_allclose(at, unit.positions(move.path.at(begins + u * durations)), atol=1e-9)


def test_the_file_is_bound_to_what_it_was_planned_with(aside: Planned) -> None:
    plan, setting = aside.plan(), aside.setting
    assert plan.speed == 0.4
    limits = setting.unit.limits(plan.speed_registers, plan.acceleration_registers)  # at speed 1
    np.testing.assert_allclose(limits.velocity, setting.limits.velocity, rtol=1e-9)
    np.testing.assert_allclose(limits.acceleration, setting.limits.acceleration, rtol=1e-9)
    scene = setting.scene
    assert scene.robot_open.digest != scene.robot_holding.digest
    stated = {
        key: plan.provenance[key] for key in ("scene", "robot_open", "robot_holding", "unit", "options")
    }
    assert stated == {
        "scene": scene.digest,
        "robot_open": scene.robot_open.digest,
        "robot_holding": scene.robot_holding.digest,
        "unit": setting.unit.digest,
        "options": setting.options.to_json(),
    }


def test_contacts_that_lines_are_allowed_are_part_of_the_scene(aside: Planned) -> None:
    pair = frozenset(("cube 1", "finger_l"))

    def allowed(plan: Plan) -> set[frozenset[str]]:
        return set(map(frozenset, plan.scene["allowed"]))

    before, after = aside.plan(), replace(aside, touching=frozenset((pair,))).plan()
    assert allowed(after) == allowed(before) | {pair}
    assert (
        after.provenance["scene"] == aside.setting.scene.allowing(aside.setting.scene.allowed | {pair}).digest
    )


def test_two_parts_as_one_state_what_both_state(aside: Planned) -> None:
    state = AttachmentState(None, None, (("cube 1", np.eye(4)),))
    pairs = frozenset((frozenset(("cube 1", "palm")),)), frozenset((frozenset(("cube 2", "palm")),))
    near = {"at": "aside", "pair": ["palm", "post"], "distance_mm": 1.0}
    one = replace(aside, lower_bound_s=1.5, touching=pairs[0], stopped="first")
    two = replace(
        aside,
        q_start=aside.q_end,
        q_end=aside.q_start,
        lower_bound_s=2.5,
        touching=pairs[1],
        near_ends=(near,),
        state=state,
        stopped="then",
    )
    both = joined(one, two)
    assert both.state is state
    assert both.lower_bound_s == 4.0
    assert both.touching == pairs[0] | pairs[1]
    assert both.near_ends == (near,)
    assert both.stopped == "first; then"
    assert (both.q_start is aside.q_start, both.q_end is aside.q_start) == (True, True)
    assert both.duration_s == pytest.approx(2.0 * aside.duration_s)
    assert both.plan().notes["near_ends"] == [near]
    assert joined(two, one).near_ends == (near,)


def test_the_clearance_is_that_of_the_nearest_move(aside: Planned) -> None:
    (move,) = aside.moves
    far = replace(move, clearance=move.clearance + 0.01)
    assert replace(aside, steps=(far, move, far)).clearance == move.clearance
    assert replace(aside, steps=()).clearance == float("inf")
