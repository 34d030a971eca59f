"""A second opinion on the time of a plan: the library toppra times a spline through each of its motions."""

from __future__ import annotations

from typing import Any

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.plan_file import Plan
from arm.robot.model import Robot
from plan.trajectory.second_opinion import time_again


def second_opinion(plan: Plan, robot: Robot, unit: Unit, limits: Limits) -> dict[str, Any]:
    """Times as planned and by toppra, s, and by how many per cent the planned ones are longer; as JSON types.

    Args:
        plan: whose motions are timed.
        robot: its arm, for the tool on lines.
        unit: in whose counts it is.
        limits: that it was planned with (`plan.program.setting.planned_limits`).

    Returns:
        planned_s, toppra_s, percent of all motions together and in `motions`, with their names; and the names of
        motions for which toppra gives no answer, in `unanswered`. Then `toppra_s` and `percent` are None.
    """
    motions: list[dict[str, Any]] = []
    for motion in plan.motions:
        names = dict.fromkeys((motion.moves[0].name, motion.moves[-1].name))
        try:
            again = time_again(motion, robot, unit, limits)
        except ImpossibleError:  # told as unanswered; the plan holds without
            again = None
        motions.append({"name": " .. ".join(names), **_compared(motion.path.duration_s, again)})
    unanswered = [m["name"] for m in motions if m["toppra_s"] is None]
    times = None if unanswered else sum(m["toppra_s"] for m in motions)
    total = _compared(sum(m["planned_s"] for m in motions), times)
    return {**total, "motions": motions, "unanswered": unanswered}


def _compared(planned: float, again: float | None) -> dict[str, Any]:
    percent = None if again is None else 100.0 * (planned / again - 1.0)
    return {"planned_s": planned, "toppra_s": again, "percent": percent}
