"""What a program is planned with: limits that leave room for rounding, configurations that are whole counts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.robot.model import Robot
from arm.robot.tool import urdf_limits
from arms.made_up import SEVEN, arm
from plan.options import PlanOptions
from plan.program.setting import Setting, planned_limits
from plan.scene import Scene
from plan.trajectory.virtual_unit import virtual_unit
from tasks.pose_lists import FAST


def test_a_planned_configuration_is_within_limits_after_rounding(robot: Robot, crs97: Unit) -> None:
    setting = Setting(Scene(robot, robot, (), ()), crs97, crs97.limits(), PlanOptions(speed=0.5))
    limits, rng = crs97.limits(), np.random.default_rng(3)
    ends = np.stack([setting.planned.lower, setting.planned.upper])
    for q in ends[rng.integers(0, 2, (200, 6)), np.arange(6)]:
        counted = crs97.positions(crs97.counts(q))
        assert (limits.lower - 1e-12 <= counted).all()
        assert (counted <= limits.upper + 1e-12).all()
    assert (setting.planned.velocity < setting.sent.velocity).all()
    assert (setting.planned.acceleration < setting.sent.acceleration).all()


def test_configurations_are_whole_counts_and_refused_beyond_limits(robot: Robot, crs97: Unit) -> None:
    setting = Setting(Scene(robot, robot, (), ()), crs97, crs97.limits(), PlanOptions())
    q = np.radians([-35.00001, -35, -85, 0, -60, 0])
    at = setting.at_counts("q_start", q)
    np.testing.assert_array_equal(at, setting.at_counts("q_start", at))
    np.testing.assert_allclose(at, q, atol=1e-4)
    with pytest.raises(InputError, match="q_start: joint J1"):
        setting.at_counts("q_start", q + [9.0, 0, 0, 0, 0, 0])


def test_unit_and_arm_have_the_same_number_of_joints(robot: Robot, crs97: Unit) -> None:
    limits = crs97.limits()
    other = virtual_unit(robot, limits)
    object.__setattr__(other, "counts_per_rad", other.counts_per_rad[:5])
    with pytest.raises(InputError, match="has 5 axes, the arm has 6 joints"):
        Setting(Scene(robot, robot, (), ()), other, limits, PlanOptions())


def test_a_joint_at_the_end_of_its_planned_range_has_one_nearest_count(tmp_path: Path) -> None:
    robot = arm(tmp_path, SEVEN)
    limits = urdf_limits(robot, 4.0)
    unit = virtual_unit(robot, limits)
    planned = planned_limits(limits, FAST, unit)
    for end in (planned.lower, planned.upper):
        for slip in (-1e-12, 1e-12):
            np.testing.assert_array_equal(unit.counts(end + slip), unit.counts(end))
    assert (unit.positions(unit.counts(planned.upper)) <= limits.upper + 1e-12).all()
    assert (planned.upper > limits.upper - 1e-6).all()
