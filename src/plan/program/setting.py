"""The setting of a program: the arm, its unit, and the limits on planned and on sent motions."""

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

ROUNDING = 1e-4  # rad, largest displacement of a joint by rounding to counts


def planned_limits(limits: Limits, options: PlanOptions, unit: Unit) -> Limits:
    """Return the limits for planning, a part of `limits` (at speed 1).

    Rounding to counts moves a joint by up to half a count, so position limits are half a count tighter.
    """
    sent = limits.scaled(options.speed)
    # slightly more than half: a joint exactly between two counts may be rounded to either
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
        scene: bodies and the arm.
        unit: counts and registers of the arm.
        limits: joint limits at speed 1.
        options: speeds, clearances.

    Attributes:
        planned: limits for planning, see `planned_limits`.
        sent: limits on the segments that are sent.
        builder: times and certifies motions.

    Raises:
        InputError: the limits or the unit have another number of joints than the arm.
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
        """Largest speed of the tool on lines, m/s."""
        return self.options.approach_speed * self.options.speed

    def at_counts(self, name: str, q: npt.ArrayLike) -> Array:
        """Return a configuration (n,) rad, rounded to whole counts.

        Raises:
            InputError: not one finite number per joint, or beyond limits by more than rounding may cause.
        """
        at = check_configuration(name, q, self.robot, self.limits, ROUNDING)
        at = check_configuration(name, self.unit.positions(self.unit.counts(at)), self.robot, self.limits)
        return frozen(at)
