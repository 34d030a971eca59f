"""What a refusal of a program adds: which key of its step may be wrong."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from arm.errors import ImpossibleError
from arm.numerics.products import mul, norm
from arm.robot.model import Robot
from cell.program.path_step import PathStep
from cell.program.program_file import ProgramTask
from cell.program.steps import PoseStep, Step

_AT_BASE = 2e-3  # m from the origin of the base, where no workpiece stands
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
    return found + in_metres(task)


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
    """Ask for the unit of a workpiece that is beside the origin of the base, as one in metres is; "" of any other."""
    origin = task.T_on_work[:3, 3]
    if task.board is not None or not 0.0 < np.abs(origin).max() < _AT_BASE:
        return ""
    shown = ", ".join(f"{1e3 * value:g}" for value in origin.tolist())
    return f"; work.origin_mm = [{shown}] is less than {1e3 * _AT_BASE:g} mm from that of the base: is it in metres?"
