"""What a program is planned with: limits that leave room for rounding, configurations that are whole counts."""

from __future__ import annotations

from dataclasses import replace
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
    for k, name in enumerate(robot.joint_names):
        for beyond in (setting.limits.lower[k] - 0.01, setting.limits.upper[k] + 0.01):
            wrong = np.where(np.arange(6) == k, beyond, q)
            with pytest.raises(InputError, match=f"q_start: joint {name}") as refused:
                setting.at_counts("q_start", wrong)
            assert refused.value.data["value"] == beyond


@pytest.mark.parametrize("speed", [0.1, 0.5, 1.0])
def test_what_is_sent_is_limited_by_the_speed_and_what_is_planned_by_a_part_of_that(
    robot: Robot, crs97: Unit, speed: float
) -> None:
    options = PlanOptions(speed=speed)
    setting = Setting(Scene(robot, robot, (), ()), crs97, crs97.limits(), options)
    full, sent, planned = crs97.limits(), setting.sent, setting.planned
    np.testing.assert_allclose(sent.velocity, speed * full.velocity)
    np.testing.assert_allclose(sent.acceleration, speed**2 * full.acceleration)
    np.testing.assert_allclose(planned.velocity, options.velocity_fraction * sent.velocity)
    np.testing.assert_allclose(planned.acceleration, options.acceleration_fraction * sent.acceleration)
    assert setting.tool_speed == pytest.approx(speed * options.approach_speed)


@pytest.mark.parametrize("seed", range(5))
def test_no_count_beyond_a_limit_is_taken(robot: Robot, crs97: Unit, seed: int) -> None:
    """A configuration at a limit is refused where its nearest counts are beyond, and taken where they are not."""
    rng, unit_limits = np.random.default_rng(seed), crs97.limits()
    q, taken = np.radians([-35, -35, -85, 0, -60, 0]), {True: 0, False: 0}
    for joint in (*range(6), *range(6)):
        upper = np.array(unit_limits.upper)
        upper[joint] = q[joint] + rng.uniform(0.0, 0.1)
        setting = Setting(
            Scene(robot, robot, (), ()), crs97, replace(unit_limits, upper=upper), PlanOptions()
        )
        at = np.array(q)
        at[joint] = upper[joint]
        beyond = bool(crs97.positions(crs97.counts(at))[joint] > upper[joint])
        taken[not beyond] += 1
        if beyond:
            with pytest.raises(InputError, match="q_start: joint J"):
                setting.at_counts("q_start", at)
        else:
            assert (setting.at_counts("q_start", at) <= upper).all()
    assert min(taken.values()) > 0


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
