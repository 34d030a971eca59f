"""Timing by the library toppra: limits hold at every instant, nothing is faster than ours, and no answer is told."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits, Unit, load_unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arms.blended_paths import blended
from plan.options import PlanOptions
from plan.program.go_to import plan_joint_motion
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from plan.trajectory import toppra_timing
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.integer_segments import to_segments
from plan.trajectory.joint_path import Path, polyline
from plan.trajectory.timing import time_curve
from tasks.pose_lists import EFFORT, TABLE, check_plan, down
from tasks.task2 import Q_START, task2


def paths(limits: Limits, count: int) -> list[Path]:
    """Splines, blended polylines, and straight ways."""
    rng, made = np.random.default_rng(12), []
    for k in range(count):
        q = rng.uniform(limits.lower, limits.upper, (rng.integers(3, 7), 6))
        match k % 3:
            case 0:
                made.append(CubicSpline(np.arange(len(q)) * rng.uniform(0.1, 10.0), q))
            case 1:
                made.append(blended(q, rng.choice([0.003, 0.03, 0.3])))
            case _:
                made.append(polyline(q[:2]))
    return made


def test_limits_hold_at_every_instant_and_the_time_is_ours() -> None:
    limits, ratios = load_unit("crs93").limits(), []
    for path in paths(limits, 12):
        timed = time_curve(path, limits, by_toppra=True)
        assert timed.method == "toppra"
        t = np.sort(np.concatenate([np.linspace(0, timed.duration, 4001), timed.times, timed.times + 1e-9]))
        state = timed.at(t)
        assert (np.abs(state.qd) / limits.velocity).max() <= 1.0 + 1e-7
        assert (np.abs(state.qdd) / limits.acceleration).max() <= 1.0 + 1e-7
        np.testing.assert_allclose(state.qd[[0, -1]], 0.0, atol=1e-6)
        ratios.append(timed.duration / time_curve(path, limits).duration)
    assert min(ratios) > 0.97
    assert max(ratios) < 1.02
    assert np.median(ratios) == pytest.approx(1.0, abs=0.005)


def test_a_result_beyond_limits_is_corrected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the library answers, limits hold; here it takes acceleration limits 30 % too high."""
    limits, honest = load_unit("crs97").limits(), toppra_timing._solved

    def too_fast(stage, limits, ease, unit, factor):  # type: ignore[no-untyped-def]
        return honest(stage, limits, ease / 1.3, unit, factor)

    monkeypatch.setattr(toppra_timing, "_solved", too_fast)
    for path in paths(limits, 3):
        timed = time_curve(path, limits, by_toppra=True)
        state = timed.at(np.linspace(0.0, timed.duration, 4001))
        assert (np.abs(state.qdd) / limits.acceleration).max() <= 1.0 + 1e-7


def test_caps_hold_in_their_piece() -> None:
    limits, rng = load_unit("crs97").limits(), np.random.default_rng(6)
    for path in paths(limits, 2):
        free = time_curve(path, limits, by_toppra=True)
        caps = np.where(rng.random(len(path.x) - 1) < 0.5, 0.4 * free.rate.max(), np.inf)
        timed = time_curve(path, limits, caps, by_toppra=True)
        inside = np.clip(np.searchsorted(path.x, (timed.s[:-1] + timed.s[1:]) / 2) - 1, 0, len(caps) - 1)
        assert (np.maximum(timed.rate[:-1], timed.rate[1:]) <= caps[inside] * (1 + 1e-6)).all()
        assert timed.duration >= free.duration * (1 - 1e-3)


def test_other_limits_are_timed_by_toppra_again() -> None:
    limits = load_unit("crs97").limits()
    timed = time_curve(paths(limits, 1)[0], limits, by_toppra=True)
    slower = timed.under(
        Limits(limits.lower, limits.upper, limits.velocity * 0.5, limits.acceleration * 0.25)
    )
    assert slower.method == "toppra"
    assert slower.duration == pytest.approx(2.0 * timed.duration, rel=1e-3)


def test_no_answer_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def silent(stage, limits, ease, unit, factor):  # type: ignore[no-untyped-def]
        tried.append(factor)

    monkeypatch.setattr(toppra_timing, "_solved", silent)
    limits = load_unit("crs97").limits()
    with pytest.raises(ImpossibleError, match="toppra finds no timing of a path; plan with timing = own"):
        time_curve(paths(limits, 1)[0], limits, by_toppra=True)
    assert tried == [1.0, 0.999, 0.99]


def test_a_list_is_timed_by_toppra_where_it_is_asked_for(robot: Robot, crs97: Unit) -> None:
    targets = [
        Target("a", down(0.45, -0.2, 0.1), free="rz", approach=0.05, retract=0.05),
        Target("b", down(0.45, 0.2, 0.1), free="rz", approach=0.05),
    ]
    q = np.radians([-35, -35, -85, 0, -60, 0])

    def planned(timing: str):  # type: ignore[no-untyped-def]
        options = PlanOptions(speed=1.0, timing=timing)
        return plan_poses(
            robot, [TABLE], targets, q, crs97.limits(), unit=crs97, options=options, effort=EFFORT
        )

    own, other = planned("own"), planned("toppra")
    check_plan(other, targets, crs97.limits(), exact=1e-4)
    assert [m.path for m in own.moves] != [m.path for m in other.moves]
    assert other.duration_s == pytest.approx(own.duration_s, rel=0.02)


def test_what_is_sent_holds_the_limits() -> None:
    unit = load_unit("crs93")
    limits = unit.limits()
    for path in paths(limits, 3):
        sent = to_segments(time_curve(path, limits, by_toppra=True), unit)
        reached = segment_extremes(sent, unit)
        assert (reached.velocity / limits.velocity).max() <= 1.0 + 1e-9
        assert (reached.acceleration / limits.acceleration).max() <= 1.0 + 1e-9


def test_a_joint_motion_is_timed_by_toppra_where_it_is_asked_for(crs97: Unit) -> None:
    scene, q = task2().scene, np.asarray(Q_START)

    def planned(timing: str):  # type: ignore[no-untyped-def]
        return plan_joint_motion(scene, q, q + 0.2, crs97, crs97.limits(), PlanOptions(timing=timing))

    own, other = planned("own"), planned("toppra")
    assert [m.path for m in own.moves] != [m.path for m in other.moves]
    assert other.duration_s == pytest.approx(own.duration_s, rel=0.02)
