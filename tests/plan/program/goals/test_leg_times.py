"""Times of legs before they are planned: bounds that no motion undercuts, estimates near what is reached."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from arm.controller.unit import Limits, load_unit
from arm.se3 import Array, frozen
from plan.cartesian.line import JointPath, follow_line
from plan.cartesian.reachability import GraspCandidate, reach
from plan.program.goals.leg_times import (
    LineEnds,
    _moving,
    leg_bounds,
    leg_times,
    line_ends,
    passing,
    standing,
)
from plan.trajectory.timing import time_curve
from plans.joined_lines import joined
from tasks.task2 import Q_START, Task2, task2

OFFSET = 0.1
ROBOT_LIMITS = load_unit("crs93").limits()
FAST = Limits(ROBOT_LIMITS.lower, ROBOT_LIMITS.upper, ROBOT_LIMITS.velocity, ROBOT_LIMITS.acceleration)
SLOW = Limits(
    ROBOT_LIMITS.lower,
    ROBOT_LIMITS.upper,
    0.9 * ROBOT_LIMITS.scaled(0.5).velocity,
    0.5 * ROBOT_LIMITS.scaled(0.5).acceleration,
)
SPEEDS = {"fast": (FAST, None), "slow": (SLOW, 0.05), "capped": (FAST, 0.1)}


@cache
def case() -> Task2:
    return task2()


@cache
def grips(placed: bool) -> tuple[tuple[GraspCandidate, JointPath], ...]:
    """Some lines at picks or places, and the same as the arm follows them outwards."""
    found = []
    for transfer in case().transfers[:2]:
        station = transfer.place if placed else transfer.pick
        table = reach(case().scene.robot_open, FAST, {station.name: station.T_base_tool}, OFFSET)
        for choice in table.holes[0].feasible()[:3]:
            T_start = station.T_base_tool[choice.yaw]
            T_end = np.array(T_start)
            T_end[:3, 3] -= OFFSET * T_start[:3, 2]
            path = follow_line(case().scene.robot_open, choice.q_hole, T_start, frozen(T_end), FAST)
            found.append((choice, path))
    return tuple(found)


def ends(placed: bool, limits: Limits, cap: float | None) -> LineEnds:
    return line_ends([choice.q_line for choice, _ in grips(placed)], OFFSET, limits, cap)


def timed(
    out: JointPath, way: list[Array], into: JointPath | None, limits: Limits, cap: float | None
) -> float:
    """Of the motion along a line, through way-points and along another line (or home), as it would be planned, s."""
    last = None if into is None else JointPath(frozen(into.q[::-1]), frozen(into.s[-1] - into.s[::-1]))
    goal = np.array(Q_START) if last is None else last.q[0]
    path = joined(out, np.stack([out.q[-1], *way, goal]), last, limits, cap)
    return time_curve(path.path, limits, path.caps).duration


@pytest.mark.few(1)
@pytest.mark.parametrize("speed", SPEEDS)
def test_no_motion_is_faster_than_its_bound(speed: str) -> None:
    """Straight across, and by random ways, which a bound must not rule out either."""
    limits, cap = SPEEDS[speed]
    rng = np.random.default_rng(1)
    bounds = leg_bounds(ends(False, limits, cap), ends(True, limits, cap), limits)
    ratios = []
    for i, (_, out) in enumerate(grips(False)):
        for j, (_, into) in enumerate(grips(True)):
            ways: list[list[Array]] = [[]]
            if (i + j) % 3 == 0:
                middle = (out.q[-1] + into.q[-1]) / 2.0
                ways += [[middle + rng.normal(size=6) * size] for size in (0.05, 0.3)]
            for way in ways:
                time = timed(out, way, into, limits, cap)
                assert bounds[i, j] <= time * (1.0 + 1e-4), (i, j)
                if not way:
                    ratios.append(bounds[i, j] / time)
    assert max(ratios) > 0.96  # the bound is not idle
    assert np.median(ratios) > 0.92


@pytest.mark.parametrize("speed", SPEEDS)
def test_estimates_are_near_the_real_time(speed: str) -> None:
    limits, cap = SPEEDS[speed]
    picks, places, home = ends(False, limits, cap), ends(True, limits, cap), standing(Q_START)
    errors = []
    for i, (_, out) in enumerate(grips(False)):
        for j, (_, into) in enumerate(grips(True)):
            errors.append(leg_times(picks, places, limits)[i, j] / timed(out, [], into, limits, cap) - 1.0)
        errors.append(leg_times(picks, home, limits)[i, 0] / timed(out, [], None, limits, cap) - 1.0)
    size = np.abs(errors)
    assert np.median(size) < 0.01
    assert size.max() < 0.03


@pytest.mark.parametrize("speed", SPEEDS)
def test_no_motion_along_a_line_is_faster_than_its_bound(speed: str) -> None:
    """Nor does it end faster: lines timed from rest to rest, and their direction at the very end."""
    limits, cap = SPEEDS[speed]
    lines = ends(False, limits, cap)
    for i, (_, path) in enumerate(grips(False)):
        least, estimate = lines.least[i], lines.time[i] + lines.start[i]
        assert least <= time_curve(path.spline, limits, cap).duration * (1.0 + 1e-4)
        assert 0.97 * estimate < least < 1.001 * estimate
        slope = np.abs(path.spline(path.s[-1], 1))
        speed_there = min((limits.velocity / slope).min(), cap or np.inf)
        assert (np.abs(lines.fastest[i]) >= slope * speed_there).all()


def test_a_joint_moves_no_faster_than_its_least_time() -> None:
    """The largest velocity that both ends allow at every moment leads just as far as asked in the given time."""
    rng = np.random.default_rng(2)
    limits = Limits(np.full(1, -9.0), np.full(1, 9.0), np.ones(1), np.full(1, 2.0))
    for _ in range(200):
        way, enter, leave = rng.uniform(0.0, (1.5, 1.0, 1.0))
        time = float(_moving(way, enter, leave, limits)[0])
        t = np.linspace(0.0, time, 20_001)
        fastest = np.minimum(1.0, np.minimum(enter + 2.0 * t, leave + 2.0 * (time - t)))
        assert np.trapezoid(fastest, t) == pytest.approx(way, abs=1e-6)


def test_a_place_to_stand_has_no_line() -> None:
    """From rest to rest, straight: bound and estimate against the exact time of the only joint that moves."""
    a = np.array(Q_START)
    for joint in range(6):
        for step in (1.0, 0.02):
            b = np.array(a)
            b[joint] += step
            v, acc = FAST.velocity[joint], FAST.acceleration[joint]
            exact = step / v + v / acc if step > v * v / acc else 2.0 * np.sqrt(step / acc)
            assert leg_bounds(standing(a), standing(b), FAST)[0, 0] == pytest.approx(exact)
            if step > v * v / acc:
                assert leg_times(standing(a), standing(b), FAST)[0, 0] == pytest.approx(exact)


def test_a_joint_rests_wherever_it_turns_back() -> None:
    """One joint out by a line, across, and in by a line, each way about, against a simulation of its fastest motion."""
    limits = Limits(np.full(1, -9.0), np.full(1, 9.0), np.ones(1), np.full(1, 2.0))

    def one(first: float, across: float, last: float) -> float:
        stops = np.cumsum([0.0, first, across, last])
        out = line_ends(np.linspace(stops[0], stops[1], 5)[None, :, None], OFFSET, limits, None)
        into = line_ends(np.linspace(stops[3], stops[2], 5)[None, :, None], OFFSET, limits, None)
        return float(leg_bounds(out, into, limits)[0, 0])

    def rest(way: float) -> float:
        return way + 0.5 if way >= 0.5 else float(np.sqrt(2.0 * way))

    assert one(1.0, 1.0, 1.0) == pytest.approx(rest(3.0))
    assert one(1.0, -1.0, -1.0) == pytest.approx(rest(1.0) + rest(2.0))
    assert one(-1.0, -1.0, 1.0) == pytest.approx(rest(2.0) + rest(1.0))
    assert one(0.1, -0.2, 0.3) == pytest.approx(rest(0.1) + rest(0.2) + rest(0.3))


def test_many_pairs_at_once_are_each_pair_alone() -> None:
    picks, places = ends(False, FAST, 0.1), ends(True, FAST, 0.1)
    for times in (leg_times, leg_bounds):
        table = times(picks, places, FAST)
        for i in range(table.shape[0]):
            for j in range(table.shape[1]):
                assert times(picks.row(i), places.row(j), FAST)[0, 0] == pytest.approx(table[i, j], abs=1e-12)


def test_a_leg_between_lines_that_are_passed_at_full_speed_is_bounded_by_that_speed() -> None:
    """The bound counts no acceleration where the lines allow the velocity already."""
    limits = Limits(np.full(2, -9.0), np.full(2, 9.0), np.array([1.0, 0.5]), np.array([2.0, 2.0]))
    q, along = np.zeros(2), limits.velocity
    depart = passing(q - along, q, along, 0.0, False)
    arrive = passing(q + 4.0 * along, q + 3.0 * along, -along, 0.0, False)
    assert leg_bounds(depart, arrive, limits) == pytest.approx(3.0)
    at_rest = passing(q, q, 0.0 * along, 0.0, True)
    # from rest the first joint loses half of its acceleration's time; the second joint waits for it
    assert leg_bounds(at_rest, arrive, limits) == pytest.approx(3.25)
    assert leg_bounds(depart, passing(q + 3.0 * along, q + 3.0 * along, 0.0 * along, 0.0, True), limits) == (
        pytest.approx(3.25)
    )
