"""What a refusal of a program adds: which key of its step may be wrong."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from arm.errors import ImpossibleError
from arm.numerics.products import mul, norm
from arm.robot.model import Robot
from arm.se3 import Array, inverse
from cell.program.path_step import PathStep
from cell.program.program_file import ProgramTask
from cell.program.steps import PoseStep, Step

_AT_BASE = 2e-3  # m from the origin of the base, where no workpiece stands
_IN_BASE = 0.1  # m from the arm's axis, where its base stands
_DOWN = -0.3  # z of a direction that points down
_EDGE = 1e-3  # m, by which a place is within a part of a path
_LEG = ", leg "  # in the names of the legs of a path, before their number
_SIZES = {  # keys of a step, or of its file, by which a path is as large as it is
    "svg": "width_mm",
    "meander_mm": "meander_mm",
    "points_mm": "points_mm",
    "line_of": "line_mm of its file",
}


def hint(task: ProgramTask, step: Step | None, error: ImpossibleError) -> str:
    """Return what a refusal may come from, to be appended to it; "" if nothing shows it."""
    pair = error.data.get("pair")
    found = _touching(step, pair) if isinstance(step, PathStep | PoseStep) else ""
    if isinstance(step, PathStep):
        found = found or _meant(task, step, pair)
        found += _extended(step, error.data) + _too_large(task, step, error.data)
    if isinstance(step, PoseStep):
        found += _unlifted(step, error)
    if isinstance(step, PathStep | PoseStep) and task.board is None and "out of reach" in str(error):
        poses = step.poses.T_work_tool if isinstance(step, PathStep) else step.T_work_tool
        found += turned_up(task, mul(task.T_on_work, poses[0])) + unplaced(task)
    return found + in_metres(task)


def turned_up(task: ProgramTask, T_base_tool: Array) -> str:
    """Say that the flange points up or sideways at a pose, which is seldom meant; "" if it points down."""
    robot = task.cell.robot()
    x, y, z = np.round(mul(T_base_tool, inverse(robot.T_end_tool))[:3, 2], 2).tolist()
    if z < _DOWN:
        return ""
    where = "up" if z > -_DOWN else "sideways"
    along = f"({x + 0.0:g}, {y + 0.0:g}, {z + 0.0:g})"
    return (
        f"; the flange would point {where}, along {along} of the base frame: are axis or rpy_deg of the step, and "
        "work.rpy_deg, right?"
    )


def unplaced(task: ProgramTask) -> str:
    """Say that a program does not state where its workpiece is; "" if it does."""
    if task.board is not None or "work.origin_mm" in task.inputs:
        return ""
    return "; the program has no work.origin_mm, so the workpiece is at the origin of the base frame"


def _unlifted(step: PoseStep, error: ImpossibleError) -> str:
    """Say that a part has no line on which it may touch what it stands on."""
    missing = [
        name for name, away in (("approach_mm", step.approach), ("retract_mm", step.retract)) if away == 0.0
    ]
    if step.part is None or not missing or "too near" not in str(error):
        return ""
    return f"; the step has no {' and no '.join(missing)}: a part may touch what it stands on along these lines only"


def _touching(step: PathStep | PoseStep, pair: Collection[str] | None) -> str:
    """Say which pairs of bodies the step lets touch, if another pair with one of them is too near."""
    if pair is None:
        return ""
    near = sorted(tuple(sorted(one)) for one in step.touch if one & set(pair))
    if not near:
        return ""
    shown, allowed = " - ".join(pair), ", ".join(" - ".join(one) for one in near)
    if frozenset(pair) in step.touch:
        where = "path only, not where it begins and ends"
        where = where if isinstance(step, PathStep) else "approach and retract only"
        return f"; touch of this step allows {shown} on its {where}"
    return f"; touch of this step allows {allowed}, not {shown}"


def _meant(task: ProgramTask, step: PathStep, pair: Collection[str] | None) -> str:
    """Say how a path lets a body of the tool touch what it is led along, if that is what is too near."""
    robot = task.cell.robot()
    arm = {body.name for body in robot.bodies}
    tool = {body.name for body in robot.bodies if body.joint == robot.end_joint}
    near = [name for name in pair or () if name in tool]
    other = [name for name in pair or () if name not in arm]
    if step.touch or not near or not other:
        return ""
    return f'; if {near[0]} is meant to touch {other[0]} on it, the step says so: touch = [["{near[0]}", "{other[0]}"]]'


def _extended(step: PathStep, data: Mapping[str, Any]) -> str:
    """Say that a place is in the part of a path by which extend_mm prolongs it."""
    if "done_m" not in data or "length_m" not in data:
        return ""
    done, left = float(data["done_m"]), float(data["length_m"]) - float(data["done_m"])
    leg = int(str(data.get("target", "")).partition(_LEG)[2] or 1)
    before, after = step.extended
    for by, to_end, at, end in ((before, done, 1, "start"), (after, left, len(step.legs()), "end")):
        if leg == at and to_end < by - _EDGE:
            return f"; it is in the {1e3 * by:g} mm by which extend_mm prolongs the {end} of the path"
    return ""


def _too_large(task: ProgramTask, step: PathStep, data: Mapping[str, Any]) -> str:
    """Say that a path which is out of reach is larger than the arm's reach."""
    reach = reach_of(task.cell.robot())
    paths = [one for one in task.steps if isinstance(one, PathStep) and one.key == step.key]
    size = np.ptp(np.concatenate([one.poses.T_work_tool[:, :3, 3] for one in paths]), axis=0)
    if not data.get("outside_m") or size.max() <= reach:
        return ""
    shown = " x ".join(f"{1e3 * v:.0f}" for v in size.tolist())
    return (
        f"; the path of this step is {shown} mm large, and the arm reaches {1e3 * reach:.0f} mm from its shoulder: "
        f"is {_SIZES[step.source]} right?"
    )


def reach_of(robot: Robot) -> float:
    """Return a distance from the second joint's axis, m, beyond which the tool frame's origin never is."""
    inner = robot.model.jointPlacements[3:]
    return float(
        sum(norm(T.translation) for T in inner) + norm(mul(robot.T_joint_end, robot.T_end_tool)[:3, 3])
    )


def in_metres(task: ProgramTask) -> str:
    """Ask for the unit of a workpiece that is where the base stands, as one in metres or cm is; "" of any other."""
    origin = task.T_on_work[:3, 3]
    if task.board is not None or not 0.0 < np.abs(origin[:2]).max() < _IN_BASE:
        return ""
    shown = ", ".join(f"{1e3 * value:g}" for value in origin.tolist())
    if np.abs(origin).max() >= _AT_BASE:
        return f"; work.origin_mm = [{shown}] is where the arm's base stands: is it in cm?"
    return f"; work.origin_mm = [{shown}] is less than {1e3 * _AT_BASE:g} mm from that of the base: is it in metres?"
