"""Motions as they are sent: joined without a stop, at rest only where something is done."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from arm.controller.unit import Limits, load_unit
from arm.errors import ImpossibleError
from arm.plan_file import Plan
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Box, Sphere
from arm.se3 import rot_z, transform
from plan.cartesian.line import Line, follow_line
from plan.collision.certificate import certify_move
from plan.collision.world import World
from plan.kinematics.ik import inverse_kinematics
from plan.motion import builder
from plan.motion.builder import MotionBuilder
from plan.motion.phase import Join, LinearPath, MotionPhase
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from plan.trajectory.extremes import segment_extremes
from plan.trajectory.joint_path import chained
from plan.trajectory.rounding import vertex_jump
from plan.trajectory.timing import time_curve
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


WAY = np.radians([[-35, -20, -100, 0, -60, 0], [0, -20, -100, 0, -60, 0], [0, -50, -60, 0, -60, 0]])


def crate_below(robot: Robot, q: np.ndarray, gap: float) -> Body:
    """A wide crate below the tool, `gap` m from the arm at q."""
    place, low, high = robot.T_base_tool(q)[:3, 3], 0.0, 0.3
    for _ in range(30):
        middle = 0.5 * (low + high)
        crate = Body("crate", Box((0.3, 0.3, 0.02)), transform(t=place - [0.0, 0.0, middle]), "wall")
        low, high = (low, middle) if World(robot, [crate]).distance(q).value > gap else (middle, high)
    return crate


@pytest.fixture
def mover(robot: Robot) -> MotionBuilder:
    return MotionBuilder(robot, virtual_unit(robot, LIMITS), LIMITS, LIMITS, FAST)


@pytest.mark.parametrize("stop", [False, True], ids=["flowing", "stopping"])
@pytest.mark.parametrize("gap", [-0.002, 0.006, 0.012])
def test_what_keeps_less_than_its_clearance_is_refused(
    robot: Robot, mover: MotionBuilder, gap: float, stop: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also what does not touch, and if no sample saw it."""
    monkeypatch.setattr(MotionPhase, "meets", lambda self, path: False)
    way = WAY[[0, 1]]
    phase = MotionPhase(
        "to a", "transit", World(robot, [crate_below(robot, way.mean(axis=0), gap)]), 0.01, way
    )
    made = mover.stopping if stop else partial(mover.run, joins=[])
    if gap > phase.clearance:
        (move,) = made([phase])
        assert phase.clearance <= move.clearance <= gap + 1e-3
        assert min(move.clearances) == move.clearance
        check = certify_move(phase.world, move.path, mover.unit, 0.01, tight=True)
        assert check.clearance - 1e-4 <= move.clearance <= check.seen
        return
    with pytest.raises(ImpossibleError, match=r"'to a': .* comes within .* of crate") as refused:
        made([phase])
    assert refused.value.data["clearance_m"] == phase.clearance
    there = phase.world.distance(refused.value.data["at"]["q"])
    assert there.value == pytest.approx(refused.value.data["distance_m"], abs=1e-6)


@pytest.mark.parametrize("beyond", ["lower", "upper"])
def test_what_goes_past_a_limit_of_position_is_refused(robot: Robot, beyond: str) -> None:
    """J2 and J3 turn between -50 and -20 deg, and -100 and -60 deg."""
    sent = {"lower": np.array(LIMITS.lower), "upper": np.array(LIMITS.upper)}
    sent[beyond][2] = np.radians({"lower": -99.0, "upper": -61.0}[beyond])
    limits = replace(LIMITS, **sent)
    mover = MotionBuilder(robot, virtual_unit(robot, LIMITS), LIMITS, limits, FAST)
    phase = MotionPhase("to a", "transit", World(robot, []), 0.01, WAY)
    for made in (partial(mover.run, joins=[]), mover.stopping):
        with pytest.raises(
            ImpossibleError, match="'to a': joint J3 would exceed its position limits"
        ) as refused:
            made([phase])
        assert refused.value.data["beyond"] == pytest.approx(np.radians(1.0), abs=1e-3)


def test_transits_are_one_move_only_in_one_world_and_near_their_target(
    robot: Robot, mover: MotionBuilder
) -> None:
    world, other = World(robot, []), World(robot, [])
    one, two = (
        MotionPhase("one", "transit", world, 0.01, WAY[:2]),
        MotionPhase("two", "transit", world, 0.01, WAY[1:]),
    )
    near, wide = Join(blend_radius=0.003), Join(blend_radius=0.05)
    corner = robot.T_base_tool(WAY[1])[:3, 3]
    for join in (near, wide):
        (move,) = mover.run([one, two], [join])
        q = mover.unit.positions(move.path.sample(2e-3))
        passed = min(float(np.linalg.norm(robot.T_base_tool(at)[:3, 3] - corner)) for at in q)
        assert passed <= join.blend_radius + 1e-4
    assert passed > 0.001  # the corner is cut where there is room
    assert len(mover.run([one, replace(two, world=other)], [wide])) == 2
    assert len(mover.run([one, two], [Join()])) == 2


@pytest.mark.parametrize("clearance", [0.01, 0.0100000999, 0.0123456789, 0.0])
def test_stated_clearances_are_never_rounded_up(clearance: float) -> None:
    stated = builder.rounded_down(clearance)
    assert clearance - 1.01e-7 < stated <= clearance


def test_a_motion_that_leaves_its_line_between_its_ends_is_seen(robot: Robot, mover: MotionBuilder) -> None:
    """A straight joint motion between the ends of a line is millimetres beside it."""
    T_start, T_end = (down(0.45, y, 0.1) @ transform(rot_z(1.0)) for y in (-0.1, 0.1))
    q = inverse_kinematics(robot, T_start, LIMITS.lower, LIMITS.upper).q[0]
    path = follow_line(robot, q, T_start, T_end, LIMITS)
    world, along = World(robot, []), LinearPath(Line(T_start, T_end), path, 0.1)
    phase = MotionPhase("line to b", "line", world, 0.01, along)
    (on_line,) = mover.run([phase], [])
    (beside,) = mover.run([MotionPhase("to b", "transit", world, 0.01, path.q[[0, -1]])], [])
    assert not mover._off_lines([phase], [], on_line.path)
    assert mover._off_lines([phase], [], beside.path)


@pytest.mark.parametrize("spare", [0.97, 0.9])
def test_rounding_costs_no_time_where_planned_limits_leave_room(robot: Robot, spare: float) -> None:
    """What is sent may exceed the limits of planning by its rounding, and is then no slower."""
    planned = replace(LIMITS, velocity=spare * LIMITS.velocity, acceleration=spare * LIMITS.acceleration)
    mover = MotionBuilder(robot, UNIT, planned, LIMITS, FAST)
    q = UNIT.positions(UNIT.counts(WAY))
    chain = chained([q], planned, 1.0)
    timed = time_curve(chain.path, planned, chain.caps, FAST.by_toppra)
    (move,) = mover.run([MotionPhase("to a", "transit", World(robot, []), 0.01, q)], [])
    assert move.path.duration_s <= timed.duration + 0.002


def test_a_corner_is_cut_no_further_than_allowed(robot: Robot, mover: MotionBuilder) -> None:
    """However much is asked to be cut: too long a cut is shortened, or refused."""
    turned = transform(rot_z(1.0))
    poses = [down(x, y, 0.1) @ turned for x, y in ((0.42, -0.1), (0.42, 0.0), (0.52, 0.0))]
    q, lines = inverse_kinematics(robot, poses[0], LIMITS.lower, LIMITS.upper).q[0], list[LinearPath]()
    for start, end in itertools.pairwise(poses):
        path = follow_line(robot, q, start, end, LIMITS)
        lines.append(LinearPath(Line(start, end), path, 0.1))
        q = path.q[-1]
    for cut, kept in ((0.004, True), (0.012, True), (0.05, False)):
        rounded = mover._rounded(lines[0], lines[1], Join(blend_radius=0.003, cut=cut))
        assert (rounded is not None) == kept
        if rounded is not None:
            length, ends = rounded
            across = ends[0] + np.linspace(0.0, 1.0, 200)[:, None] * (ends[1] - ends[0])
            away = [float(np.linalg.norm(robot.T_base_tool(at)[:3, 3] - poses[1][:3, 3])) for at in across]
            assert min(away) <= 0.003
            assert length <= cut


@pytest.mark.parametrize("opening", [0.04, 0.06])
def test_the_jaws_are_open_by_the_distance_of_their_inner_faces(opening: float) -> None:
    arm = load_a465(tool_length=0.134112, jaw_opening=opening)
    (move,) = MotionBuilder(arm, UNIT, LIMITS, LIMITS, FAST).run(
        [MotionPhase("to a", "transit", World(arm, []), 0.01, WAY)], []
    )
    assert move.jaw_opening == pytest.approx(opening)


@pytest.mark.parametrize("speed", [0.05, 0.5, 1.0])
def test_a_slow_motion_may_jump_at_joins_like_a_fast_one(robot: Robot, speed: float) -> None:
    """The controller's rule knows its registers alone, and these do not change with the speed."""
    sent = LIMITS.scaled(speed)
    mover = MotionBuilder(robot, UNIT, sent, sent, replace(FAST, speed=speed))
    assert mover._jump == pytest.approx(vertex_jump(LIMITS.acceleration))
