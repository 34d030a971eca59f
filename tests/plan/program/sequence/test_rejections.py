"""Why a step of a list of poses was refused."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.program.goals.target import Target
from plans.waypoints import planned
from tasks.pose_lists import FAST, TABLE, down


def test_a_refused_way_names_the_clearance_that_was_asked_for(robot: Robot, crs97: Unit) -> None:
    cage = [Body("wall", Box((0.9, 0.02, 1.0)), transform(t=(0.58, 0.0, 0.45)), "wall")]
    cage.append(Body("back", Box((0.9, 0.02, 1.0)), transform(t=(-0.58, 0.0, 0.45)), "wall"))
    cage.append(Body("lid", Box((2.0, 2.0, 0.02)), transform(t=(0.0, 0.0, 0.7)), "wall"))
    turned = np.radians([-60, -35, -85, 0, -60, 0])
    with pytest.raises(ImpossibleError, match=r"no path to other side") as caught:
        planned(robot, crs97, [TABLE, *cage], Target("other side", down(0.3, 0.35, 0.2)), q_start=turned)
    assert caught.value.data["clearance_m"] == FAST.clearance
    assert f"(required: {FAST.clearance * 1e3:g} mm)" in str(caught.value)
