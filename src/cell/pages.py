"""The preview page of a plan, with what the cell file knows of boards and camera."""

from __future__ import annotations

from pathlib import Path

from arm.planfile import Plan
from cell.preview.page import write_preview
from cell.taskfile import Task


def write_page(task: Task, plan: Plan, path: Path) -> None:
    """Write the page of a plan.

    Raises:
        InputError: the plan does not fit the cell, or the file cannot be written.
    """
    cell = task.cell
    write_preview(
        plan,
        cell.robot(),
        cell.robot(cell.cube_size),
        cell.unit,
        path,
        boards=cell.boards,
        dictionary=cell.dictionary,
        camera=cell.camera,
    )
