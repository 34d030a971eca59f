"""Lower bounds of times, and how close plans come to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Limits, Unit
from arm.robot.model import Robot
from plan.program.goals.leg_times import leg_bounds, stacked
from plan.program.goals.target import Target
from plan.program.sequence.times import rest_to_rest, standing_time
from plans.waypoints import Q_START, planned
from tasks.pose_lists import TABLE, down

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


@pytest.mark.parametrize("blend_radius", [0.0, 0.03])
@pytest.mark.parametrize("dwell_s", [0.0, 0.3])
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
