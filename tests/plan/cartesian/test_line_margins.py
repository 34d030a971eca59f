"""Margins of many lines at once, against the same line by itself and by forward kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.se3 import transform
from plan.cartesian.line_margins import heights_of, line_margins


@pytest.mark.parametrize("exact", [True, False])
def test_margins_are_those_of_the_configurations(robot: Robot, crs97: Unit, exact: bool) -> None:
    limits, rng = crs97.limits(), np.random.default_rng(3)
    heights = heights_of(0.05)
    q = rng.uniform(limits.lower, limits.upper, (60, 6))
    ends = np.stack([robot.T_base_tool(one) for one in q])
    found = line_margins(robot, limits, ends, heights, 0.05, exact)
    for line, branch in np.argwhere(found.outside == 0.0)[::7]:
        along = found.q[line, :, branch]
        for height, at in zip(heights, along, strict=True):
            wanted = ends[line] @ transform(t=(0.0, 0.0, -height))
            np.testing.assert_allclose(robot.T_base_tool(at), wanted, atol=1e-7)
        room = np.minimum(along - limits.lower, limits.upper - along).min(axis=0)
        assert found.margin[line, branch] == pytest.approx(room.min(), abs=1e-12)
        assert room[found.joint[line, branch]] == pytest.approx(room.min(), abs=1e-12)
        step = np.abs(np.diff(along, axis=0)).max(axis=0) / limits.velocity
        racing = step.max() > heights[1] / 0.05
        assert (found.racing[line, branch] >= 0) == racing
    assert (found.outside == 0.0).any()
    assert (found.outside > 0.0).any()


def test_what_is_near_to_a_pose_counts_as_outside_unless_it_reaches_it(robot: Robot, crs97: Unit) -> None:
    limits = crs97.limits()
    far = np.stack([transform(t=(x, 0.0, 0.6)) for x in (0.5, 1.5)])
    for exact in (True, False):
        found = line_margins(robot, limits, far, heights_of(0.05), 0.05, exact)
        assert found.outside[1].min() > 0.5
        assert not found.ok[1].any()


def test_each_line_is_judged_by_itself(robot: Robot, crs97: Unit) -> None:
    limits, rng = crs97.limits(), np.random.default_rng(4)
    ends = np.stack([robot.T_base_tool(rng.uniform(limits.lower, limits.upper)) for _ in range(20)])
    together = line_margins(robot, limits, ends, heights_of(0.05), 0.05)
    for line in range(len(ends)):
        alone = line_margins(robot, limits, ends[line : line + 1], heights_of(0.05), 0.05)
        assert (alone.margin[0] == together.margin[line]).all()
        assert (alone.worst[0] == together.worst[line]).all()
