"""Fixtures of several tests of this folder."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from tasks.pose_lists import EFFORT, FAST, TABLE, down


@pytest.fixture(scope="session")
def row(robot: Robot, crs97: Unit) -> tuple[Planned, list[Target]]:
    """Three poses on either side of a wall, with a line and a pause."""
    bodies = [TABLE, Body("wall", Box((0.4, 0.02, 0.3)), transform(t=(0.5, 0.0, 0.15)), "wall")]
    targets = [
        Target("a", down(0.45, -0.2, 0.1), free="rz", approach=0.05, retract=0.05),
        Target("b", down(0.45, 0.2, 0.1), free="rz", approach=0.05, retract=0.05, dwell_s=0.5),
        Target("c", down(0.35, 0.25, 0.15), free="rz"),
        Target("d", down(0.35, 0.15, 0.15), free="rz", by="line", blend_radius=0.003),
        Target("e", down(0.42, 0.15, 0.15), by="line", free="rz"),
    ]
    plan = plan_poses(
        robot,
        bodies,
        targets,
        np.radians([-35, -35, -85, 0, -60, 0]),
        crs97.limits(),
        options=FAST,
        effort=EFFORT,
    )
    return plan, targets
