"""Lower bounds of times, and how close plans come to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Limits, Unit
from arm.robot.model import Robot
from arm.se3 import rot_z, transform
from plan.kinematics.ik import inverse_kinematics
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.leg_times import leg_bounds, stacked
from plan.program.goals.line_chains import LineChain, LineChains
from plan.program.goals.target import Target
from plan.program.sequence.times import ChainTime, chain_time, rest_to_rest, standing_time
from plan.program.setting import Setting
from plan.scene import Scene
from plans.waypoints import Q_START, planned
from tasks.pose_lists import FAST, TABLE, down

LIMITS = Limits(np.full(2, -3.0), np.full(2, 3.0), np.array([1.0, 0.5]), np.array([2.0, 2.0]))


@pytest.mark.parametrize(
    ("points", "seconds"),
    [
        ([(0.0, 0.0), (2.0, 0.0)], 2.0 + 0.5),  # a trapezoid: way / v + v / a
        ([(0.0, 0.0), (0.02, 0.0)], 2.0 * np.sqrt(0.01)),  # a triangle
        ([(0.0, 0.0), (0.0, 0.2)], 0.4 + 0.25),
        ([(0.0, 0.0), (0.7, 0.0), (2.0, 0.0)], 2.5),  # what lies on the way costs nothing
        ([(0.0, 0.0), (2.0, 0.0), (0.0, 0.0)], 5.0),  # where a joint turns back it rests
        ([(0.0, 0.0), (2.0, 2.0)], 4.0 + 0.25),  # the slowest joint
        ([(0.0, 0.0), (0.0, 0.0)], 0.0),
    ],
)
def test_from_rest_to_rest_it_takes_what_the_slowest_joint_takes(
    points: list[tuple[float, float]], seconds: float
) -> None:
    assert rest_to_rest(np.array(points), LIMITS) == pytest.approx(seconds)


def test_bounds_between_stops_are_those_from_rest_to_rest() -> None:
    q = np.random.default_rng(4).uniform(-3.0, 3.0, (5, 2))
    depart, arrive = (
        stacked([getattr(standing_time(one), end) for one in q]) for end in ("depart", "arrive")
    )
    bounds = leg_bounds(depart, arrive, LIMITS)
    direct = [[rest_to_rest(np.array([a, b]), LIMITS) for b in q] for a in q]
    assert bounds == pytest.approx(np.array(direct))
    assert (bounds + 1e-12 >= (np.abs(q[None] - q[:, None]) / LIMITS.velocity).max(axis=-1)).all()


@pytest.mark.few(2)
@pytest.mark.parametrize("blend_radius", [0.0, 0.03])
@pytest.mark.parametrize("dwell_s", [0.0, 3.0])
def test_the_bound_of_a_list_is_close_to_its_plan_and_never_above(
    robot: Robot, crs97: Unit, dwell_s: float, blend_radius: float
) -> None:
    """Lines count with the time from rest, and legs enter and leave them no faster than they allow."""
    targets = [
        Target("a", down(0.4, -0.25, 0.15), free="rz", approach=0.05, retract=0.05, dwell_s=dwell_s),
        Target("b", down(0.42, 0.1, 0.15), free="rz", retract=0.08, blend_radius=blend_radius),
        Target("c", down(0.35, 0.25, 0.2), by="line", blend_radius=blend_radius),
        Target("d", down(0.38, 0.05, 0.25), free="rz"),
    ]
    plan = planned(robot, crs97, [TABLE], *targets)
    assert 0.8 * plan.duration_s < plan.lower_bound_s <= plan.duration_s


@pytest.mark.parametrize("speed", [0.01, 0.03, 0.5])
def test_the_bound_leaves_out_what_blends_cut_of_lines(robot: Robot, crs97: Unit, speed: float) -> None:
    """Short lines with wide blends; slow ones take little more than their length at the tool's speed."""
    line = {"by": "line", "free": "rz", "speed": speed}
    targets = [
        Target("a", down(0.40, -0.1, 0.15), free="rz", dwell_s=0.5),
        Target("b", down(0.46, -0.1, 0.15), blend_radius=0.02, **line),
        Target("c", down(0.46, -0.02, 0.15), blend_radius=0.02, **line),
        Target("d", down(0.40, -0.02, 0.15), dwell_s=0.5, **line),
    ]
    plan = planned(robot, crs97, [TABLE], *targets)
    assert plan.lower_bound_s <= plan.duration_s
    if speed == 0.01:
        assert plan.lower_bound_s > 0.8 * plan.duration_s


def chain_of(robot: Robot, unit: Unit, *targets: Target) -> tuple[LineChain, ChainTime]:
    setting = Setting(Scene(robot, robot, (TABLE,), ()), unit, unit.limits(), FAST)
    limits = setting.planned
    q = inverse_kinematics(robot, targets[0].poses[0], limits.lower, limits.upper).q[0]
    chains = LineChains(setting, AttachmentWorlds(setting.scene, targets))
    chain = chains.chain(range(len(targets)), q, "")
    return chain, chain_time(chain, targets, limits)


TURNED = transform(rot_z(1.0))  # far from the limits of J6


@pytest.mark.parametrize("speed", [0.05, 2.0])
def test_a_line_from_rest_takes_as_long_as_the_same_line_to_rest(
    robot: Robot, crs97: Unit, speed: float
) -> None:
    """An approach to a stop, and the retract from it the same way back; the joints limit the faster one."""
    pose, length = down(0.4, -0.2, 0.15) @ TURNED, 0.1
    target = Target("a", pose, approach=length, retract=length, speed=speed, dwell_s=1.0)
    _, time = chain_of(robot, crs97, target)
    assert time.arrive.least == pytest.approx(time.depart.least)
    assert time.arrive.least > length / speed
    assert time.between_s == 1.0


@pytest.mark.parametrize("blend_radius", [0.0, 0.02])
def test_the_first_stop_of_a_chain_is_behind_corners_that_are_blended(
    robot: Robot, crs97: Unit, blend_radius: float
) -> None:
    first = Target("a", down(0.4, -0.2, 0.15) @ TURNED, approach=0.06, blend_radius=blend_radius)
    second = Target("b", down(0.4, -0.1, 0.15) @ TURNED, by="line", dwell_s=0.5)
    chain, time = chain_of(robot, crs97, first, second)
    lines = chain.lines
    assert time.arrive.rests.all()
    assert np.array_equal(time.arrive.station[0], lines[0 if blend_radius == 0.0 else 1].path.q[-1])
    assert np.array_equal(time.arrive.offset[0], chain.q_in)


@pytest.mark.parametrize("along", [(0.3,), (0.5,), (0.3, 0.6)])
def test_a_target_that_is_passed_at_speed_is_no_stop_of_the_bound(
    robot: Robot, crs97: Unit, along: tuple[float, ...]
) -> None:
    """Targets on the straight joint motion cost nothing if they need not be reached exactly."""
    goal = Q_START * np.array([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    inner = [Target(f"at {u}", q=Q_START + u * (goal - Q_START), blend_radius=0.01) for u in along]
    plan = planned(robot, crs97, [TABLE], *inner, Target("goal", q=goal))
    direct = planned(robot, crs97, [TABLE], Target("goal", q=goal))
    assert plan.duration_s == pytest.approx(direct.duration_s, rel=0.01)
    assert 0.95 * plan.duration_s < plan.lower_bound_s <= plan.duration_s
    exact = [replace(target, blend_radius=0.0) for target in inner]
    stopping = planned(robot, crs97, [TABLE], *exact, Target("goal", q=goal))
    assert 0.95 * stopping.duration_s < stopping.lower_bound_s <= stopping.duration_s
