"""What can be asked of a planned list of poses."""

from __future__ import annotations

import json

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plans.waypoints import Q_START, planned
from tasks.pose_lists import TABLE


def test_export(row: tuple[Planned, list[Target]]) -> None:
    plan, _ = row
    header, *rows = plan.rows(0.02)
    assert header == ["time_s", "J1", "J2", "J3", "J4", "J5", "J6"]
    assert rows[-1][0] == pytest.approx(plan.duration_s)
    value = json.loads(json.dumps(plan.to_json()))
    # the cubics alone give the same motion
    q, t = [], []
    begin = 0.0
    for step in value["steps"]:
        for segment in step.get("segments", ()):
            c = np.array(segment["coefficients_rad"])
            q.append(c[0] + 0.3 * (c[1] + 0.3 * (c[2] + 0.3 * c[3])))
            t.append(begin + 0.3 * segment["duration_s"])
            begin += segment["duration_s"]
        begin += step.get("dwell_s", 0.0)
    assert begin == pytest.approx(plan.duration_s)
    np.testing.assert_allclose(plan.at(t), q, atol=1e-9)


def test_a_program_that_goes_nowhere_has_no_plan(robot: Robot, crs97: Unit) -> None:
    found = planned(robot, crs97, [TABLE], Target("here", q=Q_START))
    assert found.moves == ()
    with pytest.raises(ImpossibleError, match="nothing moves"):
        found.plan()
