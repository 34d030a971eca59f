"""Motions of a found sequence, with what is held and what may touch."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from plan.program.goals.target import Target
from plan.program.planned import Pause
from plan.program.pose_lists import plan_poses
from plans.waypoints import FEW, Q_START
from tasks.pose_lists import FAST, TABLE, down


@pytest.mark.parametrize("counts", [True, False])
def test_the_first_pose_may_be_where_the_arm_stands(robot: Robot, crs97: Unit, counts: bool) -> None:
    q = crs97.positions(crs97.counts(Q_START)) if counts else Q_START
    here, there = robot.T_base_tool(q), down(0.45, 0.2, 0.2)
    first = Target("here", here, dwell_s=0.3)
    for unit in (crs97, None):
        plan = plan_poses(
            robot, [TABLE], [first, Target("there", there), Target("again", there)], q, crs97.limits(),
            unit=unit, options=FAST, effort=FEW,
        )  # fmt: skip
        assert [r.target for r in plan.reached] == ["here", "there", "again"]
        np.testing.assert_allclose(plan.reached[0].q, q, atol=3e-5)
        pauses = [i for i, step in enumerate(plan.steps) if isinstance(step, Pause)]
        assert pauses == [0]  # nothing moves before it
        assert all(sum(s.duration_ms for s in move.path.segments) > 0 for move in plan.moves)
    alone = plan_poses(robot, [TABLE], [first], q, crs97.limits(), unit=crs97, options=FAST, effort=FEW)
    assert not alone.moves
    assert [r.target for r in alone.reached] == ["here"]
