"""Times of sent motions by toppra are ours to a per cent, whatever the motion is made of."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from arm.plan_file import Motion, Move
from arm.robot.model import Robot
from plan.cartesian.line import follow_line
from plan.trajectory.integer_segments import to_segments
from plan.trajectory.second_opinion import time_again
from plan.trajectory.timing import time_curve, time_path
from plans.barred_lines import GRASP, start_at, up


def move(name: str, role: str, path: CountPath) -> Move:
    return Move(name, role, None, path, None, 0.0, 0.0, ("", ""), True)


def test_a_line_and_a_way_with_a_corner_and_a_rest(robot: Robot, crs97: Unit) -> None:
    limits, q = crs97.limits(), start_at(robot, crs97)
    line = follow_line(robot, q, robot.T_base_tool(q), up(GRASP, 0.1), limits)
    out = to_segments(time_curve(line.spline, limits, 0.02), crs97)
    there = crs97.positions(np.array(out.end))
    way = np.stack([there, there + [0.5, 0.2, 0.0, 0.0, 0.0, 0.3], there + [0.9, -0.2, 0.1, 0.0, 0.0, 0.0]])
    across = to_segments(time_path(way, limits), crs97)
    rest = CountPath(across.end, (Segment(700, ((0,) * 6,) * 3),))
    for role, name in (("retract", "a"), ("transit", "retract from a")):
        motion = Motion(
            0, (move(name, role, out), move("to b", "transit", across), move("r", "transit", rest))
        )
        again = time_again(motion, robot, crs97, limits)
        assert again == pytest.approx(motion.path.duration_s, rel=0.015)
    # without the tool's speed on the line the joints would be faster there
    unknown = Motion(0, (move("a", "transit", out), *motion.moves[1:]))
    assert time_again(unknown, robot, crs97, limits) < again - 0.5


def test_a_motion_that_dawdles_is_found_out(robot: Robot, crs97: Unit) -> None:
    limits, q = crs97.limits(), start_at(robot, crs97)
    slow = time_path(np.stack([q, q + 0.4]), limits).stretched(2.0)
    motion = Motion(0, (move("to b", "transit", to_segments(slow, crs97)),))
    assert time_again(motion, robot, crs97, limits) == pytest.approx(0.5 * motion.path.duration_s, rel=0.02)
