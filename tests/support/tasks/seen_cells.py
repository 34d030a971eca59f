"""Cells as they are seen."""

from __future__ import annotations

from dataclasses import replace

from arm.plan_file import Plan
from arm.se3 import Array, frozen
from cell.files.task import Task
from cell.scene.build import T_base_cube_on_table
from cell.task.planning import Rest, plan_rest
from tasks.true_look import true_look
from vision.observation import Observation


def planned(
    task: Task, seen: Observation | None = None, done: dict[str, str] | None = None
) -> tuple[Plan, dict[str, str]]:
    """The plan of what is left from q_start, and where each cube goes in it."""
    done = done or {}
    on_table = {f"cube {place}": T_base_cube_on_table(task, place) for place in done.values()}
    plan = plan_rest(Rest(task, seen or true_look(task), task.cell.q_start, 0.5, done, on_table))
    assert plan is not None
    return plan, {c["cube"]: c["to"] for c in plan.task["cubes"]}


def with_pose(seen: Observation, name: str, T: Array) -> Observation:
    boards = tuple(
        replace(b, pose=replace(b.pose, T_base_board=frozen(T))) if b.name == name else b for b in seen.boards
    )
    return replace(seen, boards=boards)
