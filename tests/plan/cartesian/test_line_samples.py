"""Samples along lines are on the line, clear, and chained without jumps; there are none where nothing is clear."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import frozen, transform
from plan.cartesian.line_samples import LineSamples
from plan.collision.world import World
from plan.kinematics.straight_line import Line
from plans.barred_lines import GRASP, hole_scene, start_at, up

CLEARANCE = 0.005


@pytest.mark.parametrize("axes", ["z", "xy", "xyz"])
def test_samples_are_on_the_line_and_clear(robot: Robot, crs97: Unit, axes: str) -> None:
    limits = crs97.limits()
    q = start_at(robot, crs97)
    line = Line(frozen(robot.T_base_tool(q)), frozen(up(GRASP, 0.12)))
    T = line.T_end
    post = Body("post", Box((0.02, 0.02, 0.05)), transform(t=T[:3, 3] + 0.055 * T[:3, 1]), "wall")
    world = World(robot, [post])
    samples = LineSamples(robot, q, line, limits, axes)
    way = samples.way(world, CLEARANCE, 0.01)
    assert way is not None
    np.testing.assert_allclose(way(0.0), q, atol=1e-12)
    at = np.stack([way(u) for u in samples.fractions])
    off = line.deviation(np.stack([robot.T_base_tool(one) for one in at]), axes, samples.fractions)
    assert off.distance.max() < 1e-6
    assert off.angle.max() < 1e-6
    assert min(world.distance(one).value for one in at[1:]) >= CLEARANCE
    assert world.distance(at[-1]).value >= 0.01
    assert np.abs(np.diff(at, axis=0)).max() <= 0.45
    assert (at >= limits.lower - 1e-9).all()
    assert (at <= limits.upper + 1e-9).all()


def test_no_way_leads_through_a_ceiling(robot: Robot, crs97: Unit) -> None:
    q = start_at(robot, crs97)
    line = Line(frozen(robot.T_base_tool(q)), frozen(up(GRASP, 0.12)))
    lid = Body("lid", Box((0.5, 0.5, 0.01)), transform(t=(0.46, 0.11, 0.4)), "wall")
    assert LineSamples(robot, q, line, crs97.limits(), "z").way(World(robot, [lid]), CLEARANCE, 0.0) is None


def test_nothing_free_leaves_one_sample_for_each_place(robot: Robot, crs97: Unit) -> None:
    q = start_at(robot, crs97)
    line = Line(frozen(robot.T_base_tool(q)), frozen(up(GRASP, 0.12)))
    samples = LineSamples(robot, q, line, crs97.limits(), None)
    assert samples.q.shape[1] == 1
    assert samples.way(World(robot, []), CLEARANCE, 0.0) is not None


def test_chains_are_checked_between_samples(robot: Robot, crs97: Unit) -> None:
    """What the chain passes at its places is clear half way between them, too."""
    limits, count = crs97.limits(), 0
    for seed in range(8):
        at, bodies = hole_scene(seed)
        world = World(robot, bodies)
        T = transform(GRASP[:3, :3], at + [0.0, 0.0, 0.15])
        q = start_at(robot, crs97, T)
        if world.in_collision(q, CLEARANCE):
            continue
        line = Line(frozen(robot.T_base_tool(q)), frozen(transform(GRASP[:3, :3], at)))
        samples = LineSamples(robot, q, line, limits, "z")
        way = samples.way(world, CLEARANCE, 0.0)
        if way is None:
            continue
        rungs = np.stack([way(u) for u in samples.fractions])
        for a, b in pairwise(rungs):
            assert not any(world.in_collision(a + u * (b - a), CLEARANCE) for u in (0.25, 0.5, 0.75))
        count += 1
    assert count >= 3
