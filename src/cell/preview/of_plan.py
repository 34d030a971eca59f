"""The preview page of a plan, and its live page, with what the cell file knows of boards and camera."""

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
    """The page of a plan that is executed: it follows the events of the server that gives it.

    Args:
        mark: tells it from any other plan's; see `cell.live.state.NewPlan`.

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
