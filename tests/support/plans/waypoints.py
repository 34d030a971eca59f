"""Lists of poses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from tasks.pose_lists import EFFORT, FAST


def refusal_of(
    robot: Robot, unit: Unit, bodies: list[Body], *targets: Target, **more: Any
) -> ImpossibleError:
    options = more.pop("options", FAST)
    with pytest.raises(ImpossibleError) as caught:
        plan_poses(
            robot, bodies, targets, np.radians([-60, -35, -85, 0, -60, 0]), unit.limits(), options=options,
            effort=replace(EFFORT, candidates=4, detours=1), **more,
        )  # fmt: skip
    return caught.value


Q_START = np.radians([-35, -35, -85, 0, -60, 0])

FEW = replace(EFFORT, candidates=4, detours=1)


def planned(robot: Robot, unit: Unit, bodies: list[Body], *targets: Target, **more: Any) -> Planned:
    options, q_start = more.pop("options", FAST), more.pop("q_start", Q_START)
    return plan_poses(
        robot, bodies, targets, q_start, unit.limits(), unit=unit, options=options, effort=FEW, **more
    )
