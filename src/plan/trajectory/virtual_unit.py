"""A unit with very fine counts, for arms without a known controller.

Timing ends in whole counts, because only these can be sent, stored and proved to the bit. An arm without a `Unit` gets
counts of 1 urad (1 um for prismatic joints), far below any arm's repeatability. Such plans cannot be streamed. The same
inputs give the same bytes.
"""

from __future__ import annotations

import numpy as np

from arm.controller import unit_keys
from arm.controller.unit import GripperAxis, Limits, Unit
from arm.io.storage import sha256
from arm.robot.model import Robot
from arm.se3 import frozen

PER_RAD = 1e6
NO_UNIT = unit_keys.NO_UNIT  # name of such a unit


def virtual_unit(robot: Robot, limits: Limits) -> Unit:
    """Return a unit with counts of 1e-6 rad or m for every joint of an arm; axes have the names of its joints."""
    n = len(robot.joint_names)
    at_zero = np.zeros(n, dtype=np.int64)
    at_zero.flags.writeable = False
    return Unit(
        name=NO_UNIT,
        firmware="",
        axes=robot.joint_names,
        counts_per_rad=frozen(np.full(n, PER_RAD)),
        counts_at_zero=at_zero,
        lower=limits.lower,
        upper=limits.upper,
        velocity_cap=limits.velocity,
        speed_registers=(),
        acceleration_registers=(),
        axis_registers={},
        idle_release_s=0,
        homing=(),
        soft_home=frozen(np.zeros(n)),
        gripper=GripperAxis(
            axis="", open_adc=0, closed_adc=1, adc_channel=0, current_channel=0, registers={}
        ),
        rest_tolerance=unit_keys.REST_TOLERANCE,
        digest=sha256({"per_rad": PER_RAD, "axes": list(robot.joint_names)}),
    )


def is_virtual(unit: Unit) -> bool:
    """Return whether a unit is of this kind, so that its counts never limit a motion."""
    return bool(unit.counts_per_rad[0] == PER_RAD)
