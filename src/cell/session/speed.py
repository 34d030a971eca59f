"""``--speed``: in every command a fraction of what the cell file's registers allow.

Velocities scale with the fraction, accelerations with its square. A plan states the speed that it was made for. It can
be executed slower, by an override of the whole plan, but never faster: it is certified for its own speed.
"""

from __future__ import annotations

import math

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.plan_file import Plan
from arm.robot.model import Robot
from cell.config.arm_file import ArmFile
from cell.config.cell import Cell
from cell.session.overview import overview

LEAST_SPEED = 0.01


def planning_speed(cell: Cell | ArmFile, asked: float | None) -> float:
    """The speed to plan for: the requested one, or that of the cell or arm file.

    Raises:
        InputError: it is not from `LEAST_SPEED` to 1.
    """
    if asked is None:
        return cell.speed
    _require(asked, 1.0, "1 is all that the limits or the cell file's registers allow")
    return asked


def override_of(plan: Plan, asked: float | None) -> float:
    """The factor on a plan's velocities that lowers it to the requested speed; 1 if none was requested.

    Raises:
        InputError: it is not from `LEAST_SPEED` to the plan's.
    """
    if asked is None:
        return 1.0
    _require(
        asked,
        plan.speed,
        f"the plan was made for {plan.speed:g}, and execution can only lower it; plan again for a higher speed",
    )
    return min(asked / plan.speed, 1.0)


def _require(asked: float, most: float, why: str) -> None:
    if not (math.isfinite(asked) and LEAST_SPEED <= asked <= most):
        if 2.0 <= asked <= 100.0:
            why = f"it is a fraction: {asked:g} % are {asked / 100.0:g}"
        message = f"--speed {asked:g}: must be from {LEAST_SPEED:g} to {most:g}: {why}"
        raise InputError(message, option="--speed", value=asked)


def tool_words(plan: Plan, robot: Robot, unit: Unit, override: float = 1.0) -> str:
    """Maximum tool speed of a plan executed with an override, in words; empty if nothing moves."""
    if not plan.moves:
        return ""
    fastest = override * overview(plan, robot, unit).tool
    return f"the tool at most {1e3 * fastest:.0f} mm/s"
