"""The preview page and the live page of a plan, with the boards and the camera of the cell file."""

from __future__ import annotations

from pathlib import Path

from arm.io.storage import write_atomic
from arm.plan_file import Plan
from cell.files.task import Task
from cell.preview.page import preview_page


def write_page(task: Task, plan: Plan, path: Path) -> None:
    """Write the page of a plan.

    Raises:
        InputError: the plan does not fit the cell, or the file cannot be written.
    """
    write_atomic(path, _page(task, plan))


def live_page(task: Task, plan: Plan, mark: str) -> str:
    """Return the page of a plan being executed, which follows the state of its server.

    Args:
        mark: unique mark; see `cell.live.state.NewPlan`.

    Raises:
        InputError: the plan does not fit the cell.
    """
    return _page(task, plan, mark)


def _page(task: Task, plan: Plan, live: str | None = None) -> str:
    cell = task.cell
    return preview_page(
        plan,
        cell.robot(),
        cell.robot(cell.cube_size),
        cell.unit,
        boards=cell.boards,
        dictionary=cell.dictionary,
        camera=cell.camera,
        live=live,
    )
