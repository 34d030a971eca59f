"""Lines bend around what is near, where the plain line is refused; what they leave free bends, and nothing else."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Sphere
from arm.robot.tool import urdf_limits
from arm.se3 import frozen, rot_x, rot_z, transform
from arms.made_up import SEVEN, arm
from plan.cartesian.clear_line import ClearLine, follow_clear_line
from plan.cartesian.line import Line, LineOptions, follow_line
from plan.cartesian.line_samples import LineSamples
from plan.collision.world import World
from plan.kinematics.numeric_ik import solve_ik
from plan.options import SOLVERS
from plans.barred_lines import GRASP, clear_starts, hole_scene, start_above, start_at, up, with_post

CLEARANCE = 0.005
PLAIN = LineOptions(tolerance=5e-6)


def hole_line(robot: Robot, unit: Unit, seed: int) -> tuple[World, np.ndarray, Line]:
    """The line down to the hole from the start with the most room."""
    at, bodies = hole_scene(seed)
    world = World(robot, bodies)
    yaws = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    tops = [transform(rot_x(np.pi) @ rot_z(yaw), at + [0.0, 0.0, 0.15]) for yaw in yaws]
    q = clear_starts(world, unit.limits(), tops, CLEARANCE)[0]
    T = robot.T_base_tool(q)
    return world, q, Line(T, frozen(transform(T[:3, :3], T[:3, 3] - [0.0, 0.0, 0.15])))


def judged(found: ClearLine, world: World, line: Line, free_axis: str | None) -> float:
    """Least distance over a line, densely; the tool is on it, and the joints within limits at its ends."""
    q = CubicSpline(found.path.s, found.path.q)(np.linspace(0.0, found.path.s[-1], 400))
    off = line.deviation(np.stack([world.robot.T_base_tool(one) for one in q]), free_axis)
    assert off.distance.max() < 1e-5
    assert off.angle.max() < 1e-4
    assert np.abs(world.robot.T_base_tool(found.path.q[-1])[:3, 3] - line.T_end[:3, 3]).max() < 1e-5
    return min(world.distance(one).value for one in q)


@pytest.mark.few(1)
@pytest.mark.parametrize("solver", SOLVERS)
def test_a_free_turn_passes_a_post_and_then_a_plate(robot: Robot, crs97: Unit, solver: str) -> None:
    """Seeds at which the blind follower is refused, with the turn held and with as little of it as it needs."""
    solved = 0
    for seed in range(4, 8):
        world, q, line = hole_line(robot, crs97, seed)
        for axis in (None, "z"):
            options = replace(PLAIN, free_axis=axis)
            blind = follow_clear_line(world, CLEARANCE, q, line, crs97.limits(), options)
            assert not blind.check.proved
            assert blind.check.seen < CLEARANCE + 1e-4
        options = replace(PLAIN, solver=solver)
        found = follow_clear_line(world, CLEARANCE, q, line, crs97.limits(), options, "z")
        if found.check.proved:
            solved += 1
            assert found.free_axis == "z"
            assert judged(found, world, line, "z") >= CLEARANCE
            np.testing.assert_array_equal(found.path.q[0], q)
    assert solved >= 3


def test_a_line_that_is_clear_stays_as_it_is(robot: Robot, crs97: Unit) -> None:
    q, top = start_at(robot, crs97), up(GRASP, 0.1)
    line = Line(frozen(robot.T_base_tool(q)), frozen(top))
    found = follow_clear_line(World(robot, []), CLEARANCE, q, line, crs97.limits(), PLAIN, "z")
    plain = follow_line(robot, q, line.T_start, line.T_end, crs97.limits(), PLAIN)
    assert found.check.proved
    assert found.free_axis is None
    np.testing.assert_array_equal(found.path.q, plain.q)


def test_where_nothing_is_free_the_plain_line_comes_back(robot: Robot, crs97: Unit) -> None:
    world, q, line = hole_line(robot, crs97, 4)
    found = follow_clear_line(world, CLEARANCE, q, line, crs97.limits(), PLAIN, None)
    assert not found.check.proved
    plain = follow_line(robot, q, line.T_start, line.T_end, crs97.limits(), PLAIN)
    np.testing.assert_array_equal(found.path.q, plain.q)


def test_a_joint_at_its_limit_bends_a_line_and_else_refuses_it(robot: Robot, crs97: Unit) -> None:
    """Sideways with the yaw held J6 turns against J1; where it ends, only a free yaw goes on."""
    q = start_at(robot, crs97)
    start = robot.T_base_tool(q)
    line = Line(start, frozen(transform(start[:3, :3], start[:3, 3] + [-0.03, 0.1, 0.0])))
    plain = follow_line(robot, q, line.T_start, line.T_end, crs97.limits(), PLAIN)
    lower, upper = crs97.lower.copy(), crs97.upper.copy()
    middle = 0.5 * (plain.q[0, 5] + plain.q[-1, 5])
    if plain.q[-1, 5] > middle:
        upper[5] = middle
    else:
        lower[5] = middle
    limits = replace(crs97.limits(), lower=frozen(lower), upper=frozen(upper))
    with pytest.raises(ImpossibleError, match=r"joint J6 is at its \w+ limit"):
        follow_clear_line(World(robot, []), CLEARANCE, q, line, limits, PLAIN, None)
    found = follow_clear_line(World(robot, []), CLEARANCE, q, line, limits, PLAIN, "z")
    assert found.check.proved
    assert judged(found, World(robot, []), line, "z") > 0.0
    dense = CubicSpline(found.path.s, found.path.q)(np.linspace(0.0, found.path.s[-1], 1000))
    assert (dense >= lower - 1e-6).all()
    assert (dense <= upper + 1e-6).all()


def elbow_lines(robot: Robot, limits: Limits) -> Iterator[tuple[World, np.ndarray, Line]]:
    """Lines of a seven-joint arm on which the plain follower's elbow meets a ball."""
    start = transform(rot_x(np.pi), (0.45, -0.1, 0.25))
    line, alone = Line(frozen(start), frozen(transform(start[:3, :3], (0.45, 0.1, 0.25)))), World(robot, [])
    for q in solve_ik(robot, start, limits.lower, limits.upper).q:
        if alone.in_collision(q, 0.02):
            continue
        try:
            path = follow_line(robot, q, line.T_start, line.T_end, limits, PLAIN)
        except ImpossibleError:
            continue
        came, comes = (elbow_at(robot, one) for one in path.q[[0, -1]])
        ahead = (comes - came) / np.linalg.norm(comes - came)
        world = World(robot, [Body("ball", Sphere(0.03), transform(t=comes + 0.06 * ahead), "wall")])
        if world.in_collision(path.q[-1], CLEARANCE) and not world.in_collision(q, CLEARANCE):
            yield world, q, line


def elbow_at(robot: Robot, q: np.ndarray) -> np.ndarray:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return np.array(data.oMi[4].translation)


@pytest.mark.slow
def test_an_elbow_gives_way_where_no_turn_is_free(tmp_path: Path) -> None:
    robot = arm(tmp_path, SEVEN, [("l0", "l2"), ("l2", "l4"), ("l4", "l6")])
    limits = urdf_limits(robot, 4.0)
    some = list(islice(elbow_lines(robot, limits), 5))
    assert len(some) == 5
    solved = 0
    for world, q, line in some:
        bent = follow_clear_line(world, CLEARANCE, q, line, limits, PLAIN)
        assert bent.free_axis is None
        if bent.check.proved:
            solved += 1
            assert judged(bent, world, line, None) >= CLEARANCE
    assert solved >= 4


@pytest.mark.slow
def test_the_end_has_more_clearance_where_it_is_asked_for(robot: Robot, crs97: Unit) -> None:
    """Out of a hole: a transit goes on from the end of the line."""
    limits, more = crs97.limits(), 0
    for seed in (4, 5):
        at, bodies = hole_scene(seed)
        world = World(robot, bodies)
        yaws = np.linspace(-np.pi, np.pi, 24, endpoint=False)
        poses = [transform(rot_x(np.pi) @ rot_z(yaw), at) for yaw in yaws]
        for q in clear_starts(world, limits, poses, CLEARANCE)[:4]:
            T = robot.T_base_tool(q)
            line = Line(T, frozen(transform(T[:3, :3], T[:3, 3] + [0.0, 0.0, 0.10])))
            near = follow_clear_line(world, CLEARANCE, q, line, limits, PLAIN, "z")
            far = follow_clear_line(world, CLEARANCE, q, line, limits, PLAIN, "z", end_clearance=0.012)
            assert far.check.proved == near.check.proved
            if far.check.proved and world.distance(near.path.q[-1]).value < 0.012:
                more += world.distance(far.path.q[-1]).value >= 0.012
    assert more >= 8


def test_barriers_alone_bend_a_line_without_a_chain(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the chain the joints move less."""
    world, q, limits = with_post(robot), start_above(robot, crs97, 1.0), crs97.limits()
    T = robot.T_base_tool(q)
    line = Line(T, frozen(transform(T[:3, :3], T[:3, 3] + [0.0, 0.2, 0.0])))
    chained = follow_clear_line(world, CLEARANCE, q, line, limits, PLAIN, "z")
    monkeypatch.setattr(LineSamples, "way", lambda *_: None)
    alone = follow_clear_line(world, CLEARANCE, q, line, limits, PLAIN, "z")
    for found in (chained, alone):
        assert found.check.proved
        assert found.free_axis == "z"
        assert CLEARANCE <= judged(found, world, line, "z") < CLEARANCE + 2e-3
    moved = [np.abs(np.diff(found.path.q, axis=0)).sum() for found in (chained, alone)]
    assert moved[0] < moved[1]
