"""Task 2 as it is asked for: when to look, which order and places, how fast, with how much jerk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError, InputError
from arm.plan_file import LookStep, Plan
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.options import PlanOptions
from plan.program.tasks import plan_task
from plan.scene import Transfer
from tasks.task2 import Q_START, Task2, task2

UNIT = load_unit("crs93")
LIMITS = UNIT.limits()


def test_without_looks_the_arm_goes_from_cube_to_cube(plan: Plan, direct: Plan) -> None:
    assert not any(isinstance(step, LookStep) for step in direct.steps)
    assert [move.role for move in direct.moves].count("home") == 1
    assert direct.duration_s < plan.duration_s


def test_a_look_after_every_second_cube(case: Task2, plan: Plan, direct: Plan) -> None:
    some = plan_task(case.scene, case.transfers, Q_START, UNIT, options=PlanOptions(look=2))
    ends = [i for i, step in enumerate(some.steps) if isinstance(step, LookStep)]
    assert [some.steps[i - 1].role for i in ends] == ["home"] * 2  # type: ignore[union-attr]
    assert [some.steps[i - 1].cube for i in ends] == [1, 3]  # type: ignore[union-attr]
    assert direct.duration_s < some.duration_s < plan.duration_s


@pytest.mark.slow
@pytest.mark.parametrize("look", [pytest.param("each", marks=pytest.mark.slow), "never"])
def test_given_orders_and_destinations_are_kept_and_are_not_faster(
    look: str, case: Task2, plan: Plan, direct: Plan
) -> None:
    """Cubes turned round, so that neither the free order nor that of the names is meant by chance."""
    free = plan if look == "each" else direct
    places = [t.place for t in case.transfers]
    mixed = [replace(case.transfers[i], place=places[j]) for i, j in ((2, 0), (0, 3), (3, 1), (1, 2))]
    asked = [(t.cube, t.place.name) for t in mixed]
    made = {("free", "free"): free.duration_s}
    for order, assignment in (("free", "given"), ("given", "free"), ("given", "given")):
        options = PlanOptions(look=look, order=order, assignment=assignment)
        found = plan_task(case.scene, mixed, Q_START, UNIT, options=options)
        went = [(c["cube"], c["to"]) for c in found.task["cubes"]]
        if order == "given":
            assert [cube for cube, _ in went] == [cube for cube, _ in asked]
        if assignment == "given":
            assert set(went) == set(asked)
        made[order, assignment] = found.duration_s
    assert made["free", "free"] <= 1.01 * min(made.values())
    assert max(made["free", "given"], made["given", "free"]) <= 1.01 * made["given", "given"]


def test_the_order_in_which_cubes_are_listed_says_nothing(case: Task2, direct: Plan) -> None:
    options = PlanOptions(look="never")
    turned = plan_task(case.scene, case.transfers[::-1], Q_START, UNIT, options=options)
    assert turned.duration_s == pytest.approx(direct.duration_s, rel=1e-3)
    assert turned.task["no_plan_is_faster_than_s"] == direct.task["no_plan_is_faster_than_s"]


def test_spare_places_are_used_where_that_saves_time(case: Task2) -> None:
    far, near = case.transfers[0].place, [t.place for t in case.transfers[1:]]
    asked = (replace(case.transfers[0], place=far),)
    alone = plan_task(case.scene, asked, Q_START, UNIT)
    spare = plan_task(case.scene, asked, Q_START, UNIT, places=near)
    assert [c["to"] for c in alone.task["cubes"]] == [far.name]
    each = [
        plan_task(case.scene, (replace(asked[0], place=place),), Q_START, UNIT).duration_s for place in near
    ]
    assert spare.duration_s == pytest.approx(min(alone.duration_s, *each), rel=1e-3)
    kept = plan_task(case.scene, asked, Q_START, UNIT, options=PlanOptions(assignment="given"), places=near)
    assert [c["to"] for c in kept.task["cubes"]] == [far.name]


@pytest.mark.few(1)
@pytest.mark.parametrize("speed", [0.25, 0.02, 0.01])
def test_a_lower_speed_is_the_same_way_slower(case: Task2, speed: float) -> None:
    fast, slow = (
        plan_task(case.scene, case.transfers[:1], Q_START, UNIT, options=PlanOptions(speed=s))
        for s in (0.5, speed)
    )
    assert slow.duration_s / fast.duration_s == pytest.approx(0.5 / speed, rel=0.03)
    # at rest to the count; where moves meet at speed, the nearest whole millisecond: 0.5 ms of 50 mm/s
    ends = [[motion.path.end for motion in made.motions] for made in (fast, slow)]
    assert ends[0] == ends[1]
    tools = [
        [case.scene.robot_open.T_base_tool(UNIT.positions(m.path.end))[:3, 3] for m in made.moves]
        for made in (fast, slow)
    ]
    assert np.linalg.norm(np.subtract(*tools), axis=1).max() <= 1e-4


def test_jerk_is_limited_where_that_is_asked(case: Task2) -> None:
    """Ramps of acceleration take their time: within a segment, and from segment to segment."""
    ramp = 0.2
    options = PlanOptions(look="never", jerk_time=ramp)
    plan = plan_task(case.scene, case.transfers[:1], Q_START, UNIT, options=options)
    free = plan_task(case.scene, case.transfers[:1], Q_START, UNIT, options=PlanOptions(look="never"))
    assert 1.0 < plan.duration_s / free.duration_s < 1.4
    allowed = LIMITS.scaled(plan.speed).acceleration * options.acceleration_fraction / ramp
    worst = {}
    for name, some in (("limited", plan), ("free", free)):
        steps = []
        for move in some.moves:
            # accelerations 0.2 s apart, so that rounding to counts weighs little
            times = np.arange(0.0, move.path.duration_s, ramp / 2)
            q = UNIT.positions(move.path.at(times))
            if len(q) > 4:
                speed = np.diff(q, axis=0) / (ramp / 2)
                steps.append(np.abs(np.diff(speed, 2, axis=0)) / (ramp / 2) ** 2 / allowed)
        worst[name] = float(np.concatenate(steps).max())
    assert worst["limited"] < 1.2
    assert worst["free"] > 1.5


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
