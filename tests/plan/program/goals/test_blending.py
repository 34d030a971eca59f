"""Corners of the tool's way that may be cut."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit
from arm.robot.model import Robot
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from tasks.pose_lists import EFFORT, FAST, TABLE, check_plan, down


def test_where_the_tool_turns_back_there_is_no_corner_to_cut(robot: Robot, crs97: Unit) -> None:
    target = Target("a", down(0.45, -0.2, 0.1), free="rz", approach=0.03, retract=0.03, blend_radius=0.01)
    plan = plan_poses(
        robot,
        [TABLE],
        [target],
        np.radians([-35, -35, -85, 0, -60, 0]),
        crs97.limits(),
        options=FAST,
        effort=EFFORT,
    )
    check_plan(plan, [target], crs97.limits())
    tips = np.stack([robot.T_base_tool(q)[:3, 3] for q in plan.sample(0.01)[1]])
    assert np.linalg.norm(tips - target.T_base_tool[:3, 3], axis=1).min() < 2e-4
