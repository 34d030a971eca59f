"""Lists of poses that cannot be planned, or are wrong: what is said, and with which figures."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.robot.model import Robot
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from tasks.pose_lists import TABLE, down


@pytest.mark.parametrize(
    ("targets", "says"),
    [
        ([], "at least one"),
        ([Target("a", np.eye(4)), Target("a", np.eye(4))], "two are named 'a'"),
        ([Target("a", np.eye(4), attach="cup")], "attach = 'cup': must be one of table"),
        ([Target("a", np.eye(4), detach=True)], "nothing moves with the tool"),
        ([Target("a", np.eye(4), allowed_collisions={("table", "thumb")})], "allowed_collisions = 'thumb'"),
    ],
)
def test_wrong_lists(robot: Robot, crs97: Unit, targets: list[Target], says: str) -> None:
    with pytest.raises(InputError, match=says):
        plan_poses(robot, [TABLE], targets, np.zeros(6), crs97.limits())


def test_a_start_outside_limits_is_refused(robot: Robot, crs97: Unit) -> None:
    with pytest.raises(InputError, match=r"q_start: joint J2 = 171\.89 deg: must be from"):
        plan_poses(robot, [], [Target("a", down(0.4, 0.0, 0.3))], [0, 3, 0, 0, 0, 0], crs97.limits())
