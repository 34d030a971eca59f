"""Checks of configurations: one finite number per joint, within the limits."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.arguments import joints
from arm.controller.unit import Limits
from arm.errors import InputError
from arm.robot.model import Robot
from arm.se3 import Array
from plan.kinematics.product_of_exponentials import product_of_exponentials


def require_limits(robot: Robot, limits: Limits) -> None:
    """Require one limit per joint.

    Raises:
        InputError: the limits have another number of joints than the arm.
    """
    n = len(robot.joint_names)
    if limits.lower.shape != (n,):
        why = f"limits: given for {len(limits.lower)} joints, the arm has {n}: {', '.join(robot.joint_names)}"
        raise InputError(why, joints=n)


def check_configuration(
    name: str, q: npt.ArrayLike, robot: Robot, limits: Limits, slack: float = 0.0
) -> Array:
    """Return a configuration (n,) rad (m for prismatic joints) after a check of shape and limits.

    Args:
        name: name of the argument for the message.
        q: (n,), or (1, n).
        robot: the arm.
        limits: its limits.
        slack: tolerance on the limits, rad or m.

    Raises:
        InputError: wrong shape, not finite, or beyond a limit; data: joint, value, low, high (rad or m).
    """
    require_limits(robot, limits)
    at = joints(name, q, robot.joint_names)
    beyond = np.flatnonzero((at < limits.lower - slack) | (at > limits.upper + slack))
    if not len(beyond):
        return at
    k = int(beyond[0])
    joint, value = robot.joint_names[k], float(at[k])
    low, high = float(limits.lower[k]), float(limits.upper[k])
    help = "move the arm back within its limits, or give another configuration"
    if product_of_exponentials(robot).axes[k].slides:
        scale, unit = 1e3, "mm"
    else:
        scale, unit = float(np.degrees(1.0)), "deg"
        turned = value - 2.0 * np.pi * np.rint((value - (low + high) / 2.0) / (2.0 * np.pi))
        if low <= turned <= high:
            help = f"{turned * scale:.2f} deg puts the tool at the same pose"
    why = (
        f"{name}: joint {joint} = {value * scale:.2f} {unit}: must be from {low * scale:.2f} to {high * scale:.2f} "
        f"{unit}; {help}"
    )
    raise InputError(why, joint=joint, value=value, low=low, high=high)
