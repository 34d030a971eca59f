"""Motions as they are sent: joined without a stop, at rest only where something is done."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Limits, load_unit
from arm.plan_file import Plan
from arm.robot.model import Robot
from arm.robot.shapes import Body, Sphere
from arm.se3 import transform
from plan.collision.world import World
from plan.motion import builder
from plan.motion.builder import MotionBuilder
from plan.motion.phase import MotionPhase
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.joint_path import chained
from plan.trajectory.rounding import vertex_jump
from plan.trajectory.virtual_unit import virtual_unit
from tasks.pose_lists import FAST, TABLE, down
from tasks.task2 import Q_START

UNIT = load_unit("crs93")

LIMITS = UNIT.limits()


def test_moves_meet_to_the_count_and_at_speed(plan: Plan, direct: Plan, walled_plan: Plan) -> None:
    """The arm is at rest where the jaws act, where it looks and at home; elsewhere it goes on, by the vertex rule."""
    jump = vertex_jump(LIMITS.acceleration)
    scale = np.abs(UNIT.counts_per_rad)
    for made in (plan, direct, walled_plan):
        moves = list(made.moves)
        assert made.start == moves[-1].path.end == tuple(int(c) for c in UNIT.counts(Q_START))
        for before, after in itertools.pairwise(moves):
            assert before.path.end == after.path.start
        for motion in made.motions:
            first, last = motion.moves[0].path.segments[0], motion.moves[-1].path.segments[-1]
            assert np.all(np.abs(first.derivative(0.0)) / scale <= jump)
            assert np.all(np.abs(last.derivative(1.0)) / scale <= jump)
            for before, after in itertools.pairwise(motion.moves):
                left, entered = before.path.segments[-1], after.path.segments[0]
                velocity = [x / scale for x in (left.derivative(1.0), entered.derivative(0.0))]
                assert np.all(np.abs(velocity[1] - velocity[0]) <= jump)
                # the line's end is passed at the tool's own speed, or what the way across allows
                assert np.abs(velocity[0]).max() > 0.02, (before.name, after.name)


def test_the_arm_rests_only_where_something_is_done(plan: Plan, direct: Plan) -> None:
    to, across, back = ["transit", "approach"], ["retract", "transit", "approach"], ["retract", "home"]
    on = ["retract", "transit", "approach"]
    assert [[m.role for m in motion.moves] for motion in plan.motions] == [to, across, back] * 4
    assert [[m.role for m in motion.moves] for motion in direct.motions] == [
        to,
        across,
        *[on, across] * 3,
        back,
    ]


def test_no_motion_comes_to_a_stop_on_its_way(plan: Plan, direct: Plan) -> None:
    """Also inside moves: but for its first and last 0.2 s some joint is always moving."""
    for motion in (*plan.motions, *direct.motions):
        q = UNIT.positions(motion.path.sample(1e-3))
        fastest = np.abs(np.diff(q, axis=0)).max(axis=1) / 1e-3
        over_20_ms = np.convolve(fastest, np.full(20, 1 / 20), mode="valid")
        assert over_20_ms[200:-200].min() > 0.01, [m.name for m in motion.moves]


def test_no_blend_swings_past_a_limit_of_position(robot: Robot) -> None:
    """J5 turns back where the approach begins; at speed it turns 1 deg further out, unless that is past its limit."""

    def made(limits: Limits) -> tuple[Planned, float]:
        target = Target("a", down(0.5, 0.25, 0.1), approach=0.08)
        plan = plan_poses(robot, [], [target], np.radians([-35, -35, -85, 0, -30, 0]), limits, options=FAST)
        return plan, min(float(segment_extremes(m.path, plan.unit).lower[:, 4].min()) for m in plan.moves)

    plan, lowest = made(LIMITS)
    begin = float(plan.unit.positions(plan.moves[1].path.start)[4])
    assert lowest < begin - 0.005
    lower = np.array(LIMITS.lower)
    lower[4] = begin - 0.002
    assert made(replace(LIMITS, lower=lower))[1] >= lower[4] - 1e-9


def test_a_blend_that_meets_a_body_is_not_timed(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """The longest blend cuts a corner with a ball inside it; what is timed is certified at once."""
    way = np.radians([[-35, -20, -100, 0, -60, 0], [0, -20, -100, 0, -60, 0], [0, -50, -60, 0, -60, 0]])
    limits = replace(LIMITS, acceleration=0.3 * LIMITS.acceleration)
    blended = chained([way], limits, 1.0)
    passed = blended.path(np.linspace(blended.edges[0], blended.edges[-1], 600))
    u = np.linspace(0.0, 1.0, 300)[:, None]
    straight = np.concatenate([a + u * (b - a) for a, b in itertools.pairwise(way)])
    corner, inside = (robot.T_base_tool(q)[:3, 3] for q in (way[1], (way[0] + way[2]) / 2.0))
    ball = Body("ball", Sphere(0.01), transform(t=corner + 0.5 * (inside - corner)), "post")
    world = World(robot, [TABLE, ball])
    cut, kept = (min(world.distance(q).value for q in path) for path in (passed, straight))
    assert 0.0 < cut < kept - 1e-3
    timed = []
    time_curve = builder.time_curve
    monkeypatch.setattr(builder, "time_curve", lambda *given: timed.append(1) or time_curve(*given))
    mover = MotionBuilder(robot, virtual_unit(robot, limits), limits, limits, FAST)
    moves = mover.run([MotionPhase("to a", "transit", world, cut + 0.7 * (kept - cut), way)], [])
    assert len(moves) == 1
    assert moves[0].certified
    assert len(timed) == 1
