"""Phases of a motion: what they follow, and that each is certified in its own world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Cylinder
from arm.se3 import transform
from plan.cartesian.line import Line, follow_line
from plan.collision.world import World
from plan.motion.builder import MotionBuilder
from plan.motion.phase import LinearPath, MotionPhase
from plan.program.goals.target import Target
from plan.trajectory.virtual_unit import virtual_unit
from plans.waypoints import refusal_of
from tasks.pose_lists import FAST, TABLE, down


@pytest.mark.slow
def test_nothing_is_sent_that_is_not_proved(robot: Robot, crs97: Unit) -> None:
    """The search proves lines first; the mover does not believe it."""
    post = Body("post", Cylinder(0.03, 0.5), transform(t=(0.42, 0.02, 0.2)), "post")
    world = World(robot, [TABLE, post])
    grid = virtual_unit(robot, crs97.limits())
    mover = MotionBuilder(robot, grid, crs97.limits(), crs97.limits(), FAST)
    way = np.radians([[-35, -20, -100, 0, -60, 0], [35, -20, -100, 0, -60, 0], [35, -20, -90, 0, -60, 0]])
    piece = MotionPhase("to a", "transit", world, 0.01, way)
    with pytest.raises(ImpossibleError, match=r"'to a': .* comes within .* of post after"):
        mover.run([piece], [])
    clear = mover.run([replace(piece, world=World(robot, [TABLE]))], [])
    assert len(clear) == 1

    refused = refusal_of(
        robot, crs97, [TABLE, post],
        Target("a", down(0.42, -0.2, 0.2), free="rz"), Target("b", down(0.42, 0.2, 0.2), by="line", free="rz"),
    )  # fmt: skip
    assert "on the line at b" in str(refused)
    assert refused.data["pair"][1] == "post"


def test_a_reversed_line_leads_back_over_the_same_configurations(robot: Robot, crs97: Unit) -> None:
    q = np.radians([0, -35, -85, 0, -60, 0])
    start = robot.T_base_tool(q)
    end = start @ transform(t=(0.0, 0.0, -0.05))
    there = LinearPath(Line(start, end), follow_line(robot, q, start, end, crs97.limits()), 0.1)
    back = there.reversed()
    np.testing.assert_array_equal(back.path.q, there.path.q[::-1])
    np.testing.assert_allclose(np.diff(back.path.s), np.diff(there.path.s)[::-1], atol=1e-12)
    assert back.path.s[0] == 0.0
    np.testing.assert_array_equal(back.line.T_end, start)
    assert back.reversed().line.length == there.line.length


def test_a_split_line_goes_on_where_it_was_left(robot: Robot, crs97: Unit) -> None:
    q = np.radians([0, -35, -85, 0, -60, 0])
    start = robot.T_base_tool(q)
    end = start @ transform(t=(0.0, 0.0, -0.05))
    whole = LinearPath(Line(start, end), follow_line(robot, q, start, end, crs97.limits()), 0.1)
    first, last = whole.split(0.017)
    assert last.line.length == pytest.approx(0.017, abs=1e-9)
    assert first.line.length == pytest.approx(0.033, abs=1e-9)
    np.testing.assert_array_equal(first.line.T_end, last.line.T_start)
    np.testing.assert_allclose(first.path.q[-1], last.path.q[0], atol=1e-15)
    np.testing.assert_allclose(robot.T_base_tool(last.path.q[0]), last.line.T_start, atol=1e-6)
    np.testing.assert_allclose(last.path.q[-1], whole.path.q[-1], atol=1e-15)
    assert (first.path.s[0], last.path.s[0]) == (0.0, 0.0)
