"""How deep a body of the tool goes on a path into a body that it may touch there."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arm.numerics.products import mul
from arm.robot.shapes import Body
from arm.se3 import Array, inverse
from cell.program.path_step import PathStep
from cell.program.program_file import ProgramTask
from plan.collision.world import distance_of

DEEP = 2e-3  # m; a press, and what bodies and table are measured to, is less
BURIED = 0.02  # m; bodies that stand on a table may be drawn longer than they are
_STEP = 5e-3  # m between the places of a path that are asked
_MOST = 400  # of them


def depths(task: ProgramTask, T_base_work: Array) -> Iterator[str]:
    """Say of each step with which body of the tool it goes deep into which body that its `touch` names, and where most;
    and which body of the tool never comes as near as the clearance.

    The poses are those that the file states: what is free of them is not used.
    """
    around = {body.name: body for body in (*task.cell.fixed, *task.bodies_at(T_base_work))}
    deepest: dict[tuple[str, str, str], tuple[float, str]] = {}
    apart: dict[tuple[str, str, str], float] = {}
    for step in (one for one in task.steps if isinstance(one, PathStep)):
        for names in map(sorted, step.touch):
            for of_tool, other in (names, names[::-1]):
                depth, at = _deepest(task, step, T_base_work, of_tool, around.get(other))
                pair = (step.key, of_tool, other)
                apart[pair] = min(apart.get(pair, np.inf), -depth)
                if depth > max(DEEP, deepest.get((step.key, of_tool, other), (0.0, ""))[0]):
                    where = f"on path {step.name!r}, {1e3 * at:.0f} mm from its start"
                    deepest[step.key, of_tool, other] = depth, where
    for (key, of_tool, other), (depth, where) in sorted(deepest.items()):
        deep = f"{of_tool} is {1e3 * depth:.1f} mm deep in {other}"
        yield f"{task.file.name}: {key}: {where}, {deep}, which touch allows"
    for (key, of_tool, other), away in sorted(apart.items()):
        if away >= task.required:
            yield (
                f"{task.file.name}: {key}.touch: {of_tool} stays {1e3 * away:.0f} mm from {other}, which it may touch: "
                "are work.origin_mm, the place of the body and corner_mm right?"
            )


def buried(task: ProgramTask, T_base_work: Array) -> Iterator[str]:
    """Say which body of the workpiece is deep in which body of the cell."""
    for body in task.bodies_at(T_base_work):
        for other in task.cell.fixed:
            depth = -distance_of(body, other).value
            if depth > BURIED:
                yield (
                    f"{task.file.name}: {body.name} of the workpiece is {1e3 * depth:.1f} mm deep in {other.name}: is "
                    "work.origin_mm, or the place of the body, right?"
                )


def _deepest(
    task: ProgramTask, step: PathStep, T_base_work: Array, of_tool: str, other: Body | None
) -> tuple[float, float]:
    """Return how deep a body of the tool is in another one at most, and where on the path, m; 0 if there is none."""
    robot = task.cell.robot()
    tool = next((b for b in robot.bodies if b.name == of_tool and b.joint == robot.end_joint), None)
    if tool is None or other is None:
        return 0.0, 0.0
    T_tool_body = mul(inverse(mul(robot.T_joint_end, robot.T_end_tool)), tool.T_joint_body)
    s = step.poses.s
    count = min(_MOST, 2 + int(s[-1] / _STEP))
    places = np.unique(np.searchsorted(s, np.linspace(0.0, s[-1], count)).clip(0, len(s) - 1))
    poses = mul(mul(T_base_work, step.poses.T_work_tool[places]), T_tool_body)
    found = [distance_of(Body(of_tool, tool.shape, pose, "robot"), other).value for pose in poses]
    least = int(np.argmin(np.round(found, 9)))
    return -found[least], float(s[places[least]])
