"""What a program is planned with: limits that leave room for rounding, configurations that are whole counts."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.robot.model import Robot
from plan.options import PlanOptions
from plan.program.setting import Setting
from plan.scene import Scene
from plan.trajectory.virtual_unit import virtual_unit


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
