"""Where lists of poses begin and end: near to something, where the arm stands already, and at bodies to be taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Sphere
from arm.se3 import transform
from plan.collision.world import World
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from plan.trajectory.extremes import segment_extremes
from plans.waypoints import Q_START, planned
from tasks.pose_lists import EFFORT, FAST, TABLE, down


def beside_the_hand(robot: Robot, q: np.ndarray, gap: float) -> Body:
    """A ball whose distance from the arm at q is `gap` m: sideways of the hand."""
    T = robot.T_base_tool(q)
    side = 0.1
    for _ in range(20):
        ball = Body("ball", Sphere(0.02), T @ transform(t=(0.0, side, -0.02)), "post")
        side -= World(robot, [ball]).distance(q).value - gap
    return ball


@pytest.mark.parametrize("room", [0.0001, 0.0004])
def test_an_arm_that_keeps_the_clearance_may_leave_and_arrive(robot: Robot, crs97: Unit, room: float) -> None:
    """What is asked is what the ends have to keep: the margin that ways are searched with is not asked of them."""
    at = crs97.positions(crs97.counts(Q_START))
    bodies = [TABLE, beside_the_hand(robot, at, FAST.clearance + room)]
    assert World(robot, bodies).distance(at).value == pytest.approx(FAST.clearance + room, abs=1e-6)
    plan = planned(robot, crs97, bodies, Target("away", down(0.45, 0.2, 0.2), free="rz"), q_end=Q_START)
    assert plan.clearance >= FAST.clearance
    assert plan.moves[0].clearance < FAST.clearance + room
    with pytest.raises(ImpossibleError, match=r"q_start: \w+ is \d+\.\d mm from ball") as caught:
        planned(
            robot, crs97, bodies, Target("away", down(0.45, 0.2, 0.2), free="rz"),
            options=replace(FAST, clearance=FAST.clearance + room + 0.0002),
        )  # fmt: skip
    assert caught.value.data["distance_m"] == pytest.approx(FAST.clearance + room, abs=1e-6)


@pytest.mark.slow
def test_rounded_segments_stay_within_limits(robot: Robot, crs97: Unit) -> None:
    """A free turn that would end at a joint's limit ends a count before it."""
    wall = Body("wall", Box((0.4, 0.02, 0.3)), transform(t=(0.5, 0.0, 0.15)), "wall")
    limits = crs97.limits()
    tight = replace(limits, lower=limits.lower + (0, 0, 0, 0, 0, 1.0000033), upper=limits.upper)
    targets = [
        Target("a", down(0.45, -0.2, 0.1), free="rz"),
        Target("b", down(0.45, 0.2, 0.1), free="rz"),
        Target("c", down(0.4, -0.25, 0.12), free="rz"),
    ]
    for few in (1, 2):
        for asked in (limits, tight):
            plan = plan_poses(
                robot, [TABLE, wall], targets, Q_START, asked, unit=crs97, options=FAST,
                effort=replace(EFFORT, candidates=few),
            )  # fmt: skip
            for move in plan.moves:
                extremes = segment_extremes(move.path, crs97)
                assert (extremes.lower >= asked.lower - 1e-12).all()
                assert (extremes.upper <= asked.upper + 1e-12).all()
