"""``--speed``, which means the same everywhere: a share of what the cell file's registers allow.

Velocities are at most so much of theirs, accelerations its square. A plan is made for such a speed and says it. It can
be executed slower, by an override of the whole plan; never faster, for it was certified as it is.
"""

from __future__ import annotations

import math

from arm.errors import InputError
from arm.plan_file import Plan
from cell.config.cell import Cell
from cell.session.overview import overview

LEAST_SPEED = 0.01


def planning_speed(cell: Cell, asked: float | None) -> float:
    """The speed to plan for: what was asked for, or the cell file's.

    Raises:
        InputError: it is not from `LEAST_SPEED` to 1.
    """
    if asked is None:
        return cell.speed
    _require(asked, 1.0, "the most that the cell file's registers allow is 1")
    return asked


def override_of(plan: Plan, asked: float | None) -> float:
    """The factor on all of a plan's velocities that lowers it to the speed asked for; 1 where none was.

    Raises:
        InputError: it is not from `LEAST_SPEED` to the plan's.
    """
    if asked is None:
        return 1.0
    _require(
        asked,
        plan.speed,
        f"the plan was made for {plan.speed:g}, and an execution only lowers; plan for more",
    )
    return min(asked / plan.speed, 1.0)


def _require(asked: float, most: float, why: str) -> None:
    if not (math.isfinite(asked) and LEAST_SPEED <= asked <= most):
        raise InputError(
            f"--speed {asked:g}: must be from {LEAST_SPEED:g} to {most:g}: {why}",
            option="--speed",
            value=asked,
        )


def tool_words(plan: Plan, cell: Cell, override: float = 1.0) -> str:
    """How fast the tool is at the fastest point of a plan that is executed at an override; empty if nothing moves."""
    if not plan.moves:
        return ""
    fastest = override * overview(plan, cell.robot(cell.cube_size), cell.unit).tool
    return f"the tool at most {1e3 * fastest:.0f} mm/s"
