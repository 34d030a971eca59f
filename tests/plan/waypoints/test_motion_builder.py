"""Motions of a found sequence, proved phase by phase."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Cylinder
from arm.se3 import transform
from plan.collision.world import World
from plan.trajectory.virtual_unit import virtual_unit
from plan.waypoints.motion_builder import PoseMotionBuilder, PoseMotionPhase
from plan.waypoints.target import Target
from plans.waypoints import refusal_of
from tasks.pose_lists import FAST, TABLE, down


def test_nothing_is_sent_that_is_not_proved(robot: Robot, crs97: Unit) -> None:
    """The search proves lines first; the mover does not believe it."""
    post = Body("post", Cylinder(0.03, 0.5), transform(t=(0.42, 0.02, 0.2)), "post")
    world = World(robot, [TABLE, post])
    grid = virtual_unit(robot, crs97.limits())
    mover = PoseMotionBuilder(
        robot, grid, crs97.limits(), crs97.limits(), FAST, [Target("a", down(0.42, 0.0, 0.3))]
    )
    way = np.radians([[-35, -20, -100, 0, -60, 0], [35, -20, -100, 0, -60, 0], [35, -20, -90, 0, -60, 0]])
    piece = PoseMotionPhase("to a", "transit", world, 0.01, None, frozenset(), way=way)
    with pytest.raises(ImpossibleError, match=r"to a: .* comes within .* of post after"):
        mover.run([piece], [])
    clear = mover.run([replace(piece, world=World(robot, [TABLE]))], [])
    assert len(clear) == 1

    refused = refusal_of(
        robot, crs97, [TABLE, post],
        Target("a", down(0.42, -0.2, 0.2), free="rz"), Target("b", down(0.42, 0.2, 0.2), by="line", free="rz"),
    )  # fmt: skip
    assert "on the line at b" in str(refused)
    assert refused.data["pair"][1] == "post"
