"""Whether the arm may stand where a caller says: one number per joint, finite, within the limits."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.arguments import joints
from arm.controller.unit import Limits
from arm.errors import InputError
from arm.robot.model import Robot
from arm.se3 import Array
from plan.kinematics.product_of_exponentials import screw_arm


def require_limits(robot: Robot, limits: Limits) -> None:
    """Refuse limits of another arm.

    Raises:
        InputError: there is not one for each joint.
    """
    n = len(robot.joint_names)
    if limits.lower.shape != (n,):
        raise InputError(
            f"limits: given for {len(limits.lower)} joints, the arm has {n}: {', '.join(robot.joint_names)}",
            joints=n,
        )


def standing(name: str, q: npt.ArrayLike, robot: Robot, limits: Limits, slack: float = 0.0) -> Array:
    """A configuration (n,) rad (m for sliding joints) that the arm may stand in.

    Args:
        name: of the argument, for the message.
        q: (n,), or (1, n).
        slack: what it may lie beyond a limit, rad or m.

    Raises:
        InputError: of another shape, not finite, or beyond a limit; data: joint, value, low, high (rad or m).
    """
    require_limits(robot, limits)
    at = joints(name, q, robot.joint_names)
    beyond = np.flatnonzero((at < limits.lower - slack) | (at > limits.upper + slack))
    if not len(beyond):
        return at
    k = int(beyond[0])
    joint, value = robot.joint_names[k], float(at[k])
    low, high = float(limits.lower[k]), float(limits.upper[k])
    help = "move the arm back inside, or give another configuration"
    if screw_arm(robot).axes[k].slides:
        scale, unit = 1e3, "mm"
    else:
        scale, unit = float(np.degrees(1.0)), "deg"
        turned = value - 2.0 * np.pi * np.rint((value - (low + high) / 2.0) / (2.0 * np.pi))
        if low <= turned <= high:
            help = f"{turned * scale:.2f} deg puts the tool at the same pose"
    raise InputError(
        f"{name}: joint {joint} = {value * scale:.2f} {unit}: must be from {low * scale:.2f} to {high * scale:.2f} "
        f"{unit}; {help}",
        joint=joint,
        value=value,
        low=low,
        high=high,
    )
