"""What the planner is asked to keep and to seek: the options of a task at a speed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from cell.files.task import Task
from plan.options import PlanOptions


def options_of(task: Task, speed: float) -> PlanOptions:
    """Planner options for a task at a speed."""
    cell = task.cell
    jaws: dict[str, Any] = {}
    if cell.has_jaws:
        jaws["fraction_closed"] = round(cell.gripper.fraction_closed(cell.gripper.close_to), 9)
    return PlanOptions(
        speed=speed,
        velocity_fraction=cell.velocity_fraction,
        acceleration_fraction=cell.acceleration_fraction,
        clearance=cell.clearance,
        least_clearance=cell.least_clearance,
        offset=cell.offset,
        approach_speed=cell.approach_speed,
        jerk_time=cell.jerk_time,
        solver=cell.solver,
        timing=cell.timing,
        settle_s=cell.settle_s,
        look=task.look_after,
        order=task.order,
        assignment=task.assignment,
        aim=task.aim,
        clearance_worth=task.clearance_worth,
        seed=task.seed,
        **jaws,
    )


def pose_list_options(task: Task, speed: float) -> PlanOptions:
    """Planner options for a list of poses: lines keep the same clearance as transits, and the arm never looks."""
    return replace(options_of(task, speed), line_clearance=task.cell.clearance, look="never")
