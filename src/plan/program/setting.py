"""What a program is planned with: the arm, its unit, and the limits of planning and of what is sent."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits, Unit
from arm.errors import InputError
from arm.se3 import Array, frozen
from plan.kinematics.configuration import check_configuration, require_limits
from plan.motion.builder import MotionBuilder
from plan.options import PlanOptions
from plan.scene import Scene

ROUNDING = 1e-4  # rad, the most by which rounding to counts may move a joint


def planned_limits(limits: Limits, options: PlanOptions, unit: Unit) -> Limits:
    """Return the part of the limits (at speed 1) that motion is planned under.

    Rounding to counts moves a joint by up to half a count, so positions end half a count before the limits.
    """
    sent = limits.scaled(options.speed)
    # and a little more, as a joint at such an end would be half way between two counts, which may round to either
    half = np.minimum(0.501 / np.abs(unit.counts_per_rad), (limits.upper - limits.lower) / 4.0)
    return Limits(
        frozen(limits.lower + half),
        frozen(limits.upper - half),
        frozen(sent.velocity * options.velocity_fraction),
        frozen(sent.acceleration * options.acceleration_fraction),
    )


class Setting:
    """The arm, its unit and its limits.

    Args:
        scene: with the arm.
        unit: its counts and registers.
        limits: at speed 1.
        options: speeds, clearances.

    Attributes:
        planned: limits that motion is planned under, see `planned_limits`.
        sent: limits that hold on what is sent.
        builder: times and certifies motions.

    Raises:
        InputError: limits or unit of an arm with another number of joints.
    """

    def __init__(self, scene: Scene, unit: Unit, limits: Limits, options: PlanOptions) -> None:
        robot = scene.robot_open
        require_limits(robot, limits)
        n = len(robot.joint_names)
        if unit.counts_per_rad.shape != (n,):
            why = f"unit {unit.name}: has {len(unit.counts_per_rad)} axes, the arm has {n} joints"
            raise InputError(why, name=unit.name, joints=n)
        self.scene, self.robot, self.unit, self.limits, self.options = scene, robot, unit, limits, options
        self.sent = limits.scaled(options.speed)
        self.planned = planned_limits(limits, options, unit)
        self.builder = MotionBuilder(robot, unit, self.planned, self.sent, options)

    @property
    def tool_speed(self) -> float:
        """Cap on the tool's speed on lines, m/s."""
        return self.options.approach_speed * self.options.speed

    def at_counts(self, name: str, q: npt.ArrayLike) -> Array:
        """Return a configuration (n,) rad as whole counts give it.

        Raises:
            InputError: not one finite number per joint, or beyond limits by more than what rounding does.
        """
        at = check_configuration(name, q, self.robot, self.limits, ROUNDING)
        at = check_configuration(name, self.unit.positions(self.unit.counts(at)), self.robot, self.limits)
        return frozen(at)
