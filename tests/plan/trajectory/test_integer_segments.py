"""Integer segments: exact sums, rest at both ends, limits at every instant, on the line every millisecond."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError, InputError
from arm.robot.model import Robot
from arm.se3 import rot_x, rot_z, rotation, transform
from arms.blended_paths import time_blended
from arms.segmented import check_chain, check_limits, time_limits
from plan.cartesian.line import JointPath, Line, follow_line
from plan.cartesian.reachability import reach
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.integer_segments import (
    LineTolerance,
    MarksTooNear,
    _first_knots,
    _Fit,
    _slower,
    to_marked_segments,
    to_segments,
)
from plan.trajectory.joint_path import Chained
from plan.trajectory.rounding import vertex_jump
from plan.trajectory.timing import time_curve
from plans.joined_lines import joined


@pytest.mark.parametrize("segment_ms", [100, 400])
def test_segments_are_halved_where_the_motion_asks_for_shorter_ones(unit: Unit, segment_ms: int) -> None:
    """Whatever length was asked for, and with room enough that no motion is made slower."""
    limits, rng = unit.limits(), np.random.default_rng(7)
    planned = Limits(limits.lower, limits.upper, limits.velocity * 0.6, limits.acceleration * 0.3)
    for _ in range(6):
        trajectory = time_blended(rng.uniform(limits.lower, limits.upper, (4, 6)), planned, blend=0.2)
        path = to_segments(trajectory, unit, segment_ms, limits=limits)
        check_limits(path, unit, limits)
        t = np.arange(0.0, path.duration_s, 0.004)
        off = np.abs(
            unit.positions(path.at(t)) - trajectory.stretched(path.duration_s / trajectory.duration).at(t).q
        )
        assert (off <= 2.2e-4 + 2.0 / np.abs(unit.counts_per_rad)).all()
        assert path.duration_s < trajectory.duration + 1.1e-3


@pytest.mark.few(5)
@pytest.mark.parametrize("speed", [1.0, 0.3, 0.1, 0.02])
@pytest.mark.parametrize("share", [1.0, 0.15])
def test_velocities_jump_at_joins_by_no_more_than_is_allowed(unit: Unit, speed: float, share: float) -> None:
    """The controller's rule is that of its registers, at every speed; a stricter one is kept by longer segments."""
    if share < 1.0 and speed < 0.1:
        return  # less than counts allow
    limits, rng = unit.limits().scaled(speed), np.random.default_rng(3)
    for _ in range(6):
        first = rng.uniform(0.5 * limits.lower, 0.5 * limits.upper)
        trajectory = time_blended(first + rng.uniform(-0.3, 0.3, (4, 6)), time_limits(limits), blend=0.2)
        jump = share * vertex_jump(limits.acceleration, speed)
        path = to_segments(trajectory, unit, limits=limits, jump=jump)
        assert (segment_extremes(path, unit).jumps <= jump).all()
        assert path.duration_s < 1.005 * trajectory.duration


@pytest.mark.parametrize("joint", range(6))
def test_only_limits_that_are_exceeded_are_lowered_for_the_next_timing(unit: Unit, joint: int) -> None:
    limits = unit.limits()
    trajectory = time_blended(np.array([np.zeros(6), np.full(6, -0.3)]), limits)
    for kind, over, below in (("velocity", 1.02, 1.001), ("acceleration", 1.2, 1.01)):
        load = {"velocity": np.full((3, 6), 0.9), "acceleration": np.full((3, 6), 1.0)}
        load[kind][1, joint] = over
        fit = _Fit(
            np.arange(4),
            np.zeros((3, 3, 6), int),
            load["velocity"],
            load["acceleration"],
            np.zeros((2, 6)),
            np.zeros(3),
            (),
        )
        slower = _slower(trajectory, fit)
        for name in ("velocity", "acceleration"):
            asked = np.array(getattr(limits, name))
            asked[joint] /= over * below if name == kind else 1.0
            np.testing.assert_allclose(getattr(slower.limits, name), asked)


@pytest.mark.few(2)
@pytest.mark.parametrize("speed", [1.0, 0.5])
def test_lines_stay_on_the_line_every_millisecond(robot: Robot, unit: Unit, speed: float) -> None:
    """The issue asks for 0.1 mm and 0.05 deg."""
    rng, limits, grasps = np.random.default_rng(4), unit.limits().scaled(speed), {}
    for k in range(12):
        tilt = rotation(rng.uniform(-0.26, 0.26, 3) * (1, 1, 0))
        place = (rng.uniform(0.35, 0.55), rng.uniform(-0.25, 0.25), rng.uniform(0.02, 0.15))
        grasps[str(k)] = [transform(tilt @ rot_x(np.pi) @ rot_z(rng.uniform(-3, 3)), place)]
    count, arm = 0, product_of_exponentials(robot)
    for hole in reach(robot, limits, grasps, 0.1).holes:
        for choice in hole.feasible():
            T = grasps[hole.hole][0]
            line = Line(T, transform(T[:3, :3], T[:3, 3] - 0.1 * T[:3, 2]))
            followed = follow_line(robot, choice.q_hole, line.T_start, line.T_end, limits)
            trajectory = time_curve(followed.spline, time_limits(limits), rate_cap=0.1 * speed)
            path = to_segments(trajectory, unit, limits=limits, line=LineTolerance(robot, line))
            q = unit.positions(path.sample(1e-3))
            away = line.deviation(arm.tool_poses(q))
            assert away.distance.max() <= 1e-4
            assert away.angle.max() <= np.radians(0.05)
            check_chain(path, unit, followed.q[0], followed.q[-1])
            check_limits(path, unit, limits)
            count += 1
    assert count >= 12


def test_long_segments_are_halved_until_the_tool_is_on_its_line(robot: Robot, unit: Unit) -> None:
    """The tool's tolerance alone asks for that: the joints are left a lot."""
    T = transform(rot_x(np.pi), (0.45, 0.1, 0.1))
    limits, arm = unit.limits(), product_of_exponentials(robot)
    choice = next(c for hole in reach(robot, limits, {"0": [T]}, 0.25).holes for c in hole.feasible())
    line = Line(T, transform(T[:3, :3], T[:3, 3] - 0.25 * T[:3, 2]))
    followed = follow_line(robot, choice.q_hole, line.T_start, line.T_end, limits)
    trajectory, found = time_curve(followed.spline, time_limits(limits), rate_cap=0.1), {}
    for tolerance in (None, LineTolerance(robot, line, 3e-5)):
        path = to_segments(trajectory, unit, 3000, limits=limits, line=tolerance, deviation=0.05)
        found[tolerance is None] = line.deviation(
            arm.tool_poses(unit.positions(path.sample(1e-3)))
        ).distance.max()
    assert found[True] > 4e-4
    assert found[False] <= 4e-5  # between the places of a segment where it is looked at


def _legs(robot: Robot, limits: Limits, count: int) -> list[tuple[Line, Chained, Line]]:
    """Retract, transit and approach between random holes, some with a way-point between."""
    rng, grasps = np.random.default_rng(8), {}
    for k in range(6):
        tilt = rotation(rng.uniform(-0.2, 0.2, 3) * (1, 1, 0))
        place = (rng.uniform(0.38, 0.5), rng.uniform(-0.2, 0.2), rng.uniform(0.02, 0.12))
        grasps[str(k)] = [transform(tilt @ rot_x(np.pi) @ rot_z(rng.uniform(-1, 1)), place)]
    ways = []
    for hole in reach(robot, limits, grasps, 0.1).holes:
        T = grasps[hole.hole][0]
        line = Line(T, transform(T[:3, :3], T[:3, 3] - 0.1 * T[:3, 2]))
        for choice in hole.feasible()[:2]:
            ways.append((line, follow_line(robot, choice.q_hole, line.T_start, line.T_end, limits)))
    legs = []
    for k in range(count):
        (first, out), (last, back) = (ways[i] for i in rng.permutation(len(ways))[:2])
        approach = JointPath(back.q[::-1], back.s[-1] - back.s[::-1])
        q = np.array([out.q[-1], approach.q[0]])
        if k % 2:
            q = np.insert(q, 1, q.mean(axis=0) + rng.normal(0, 0.1, 6), axis=0)
        legs.append((first, joined(out, q, approach, limits, 0.1), Line(last.T_end, last.T_start)))
    return legs


@pytest.mark.few(2)
@pytest.mark.parametrize("room", [1.0, 0.5])
def test_joined_motions_have_joins_at_their_marks(robot: Robot, unit: Unit, room: float) -> None:
    limits, arm, losses = unit.limits(), product_of_exponentials(robot), []
    planned = Limits(
        limits.lower, limits.upper, limits.velocity * (0.4 + 0.6 * room), limits.acceleration * room
    )
    for before, leg, after in _legs(robot, planned, 12):
        trajectory = time_curve(leg.path, planned, leg.caps)
        tolerances = (LineTolerance(robot, before), LineTolerance(robot, after))
        marked = to_marked_segments(trajectory, unit, limits=limits, marks=leg.edges[1:-1], lines=tolerances)
        path, (first, last) = marked.path, marked.first
        check_chain(path, unit, leg.path(leg.path.x[0]), leg.path(leg.path.x[-1]))
        check_limits(path, unit, limits)
        losses.append(path.duration_s / trajectory.duration - 1.0)
        # the joins are where the marks are, to a ms of travel and what positions may be off
        knots = unit.positions(path.knots())
        near = 2e-3 * limits.velocity + 2.5e-4 + 6.0 / np.abs(unit.counts_per_rad)
        assert 0 < first < last < len(path.segments)
        for index, mark in zip(marked.first, leg.edges[1:-1], strict=True):
            assert (np.abs(knots[index] - leg.path(mark)) <= near).all()
        # both lines are lines, every millisecond, and stay inside their ends
        ends = np.cumsum([s.duration_ms for s in path.segments])
        q = unit.positions(path.sample(1e-3))
        for line, part in ((before, q[: ends[first - 1] + 1]), (after, q[ends[last - 1] :])):
            poses = arm.tool_poses(part)
            away = line.deviation(poses)
            assert away.distance.max() <= 1e-4
            assert away.angle.max() <= np.radians(0.05)
    assert np.median(losses) <= 0.003
    assert max(losses) <= 0.01


def test_marks_at_the_ends_need_no_join_and_none_fits_between_two_places(crs97: Unit) -> None:
    limits, q = crs97.limits(), np.array([np.zeros(6), np.full(6, -0.3)])
    trajectory = time_blended(q, limits)
    begin, end = trajectory.s[[0, -1]]
    marked = to_marked_segments(trajectory, crs97, limits=limits, marks=(begin, end))
    assert marked.first == (0, len(marked.path.segments))
    assert marked.path == to_segments(trajectory, crs97)
    middle = (begin + end) / 2
    marked = to_marked_segments(trajectory, crs97, limits=limits, marks=(middle,))
    assert 0 < marked.first[0] < len(marked.path.segments)
    with pytest.raises(MarksTooNear, match="must be 40 ms apart"):
        to_marked_segments(trajectory, crs97, limits=limits, marks=(middle, middle + 1e-3 * (end - begin)))


def test_impossible_conversions_to_segments_are_refused(crs97: Unit) -> None:
    trajectory = time_blended(np.array([np.zeros(6), np.full(6, -0.3)]), crs97.limits())
    with pytest.raises(InputError, match="at least 40"):
        to_segments(trajectory, crs97, 10)
    with pytest.raises(InputError, match="0 ms"):
        segment_extremes(CountPath((0,) * 6, (Segment(0, ((0,) * 6,)),)), crs97)
    crawl = crs97.limits().scaled(1e-4)
    with pytest.raises(ImpossibleError, match=r"axis B exceeds its limits after rounding to counts"):
        to_segments(time_blended(np.array([np.zeros(6), np.full(6, -1e-4)]), crawl), crs97)


def test_the_join_of_the_last_of_several_marks_is_not_before_it_and_of_the_others_not_after(
    crs97: Unit,
) -> None:
    """So nothing of a transit is in a line."""
    limits = crs97.limits()
    trajectory = time_blended(np.array([np.zeros(6), np.full(6, -0.3)]), limits)
    for first, last in ((0.31, 0.77), (0.2, 0.5), (0.45, 0.91)):
        marks = tuple(float(trajectory.s[0] + part * np.ptp(trajectory.s)) for part in (first, last))
        for late, given_ in (((False, True), None), ((True, False), (True, False))):
            marked = to_marked_segments(trajectory, crs97, limits=limits, marks=marks, late=given_)
            ends = np.cumsum([s.duration_ms for s in marked.path.segments]) / 1e3
            passed = trajectory.stretched(ends[-1] / trajectory.duration).passed(marks)
            for index, time, is_late in zip(marked.first, passed, late, strict=True):
                past_s = ends[index - 1] - time
                assert 0.0 <= (past_s if is_late else -past_s) + 1e-8 < 1.01e-3


def test_a_switch_at_a_fixed_knot_adds_no_knot() -> None:
    timed: Any = SimpleNamespace(switches=lambda: np.array([1.0, 2.0]))
    assert _first_knots(timed, (0, 1000, 2000), 250, 40.0).tolist() == list(range(0, 2001, 250))
