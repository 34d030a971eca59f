"""The preview page and the live page of a plan, with the boards and the camera of the cell file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from arm.controller.unit import Unit
from arm.io.storage import write_atomic
from arm.plan_file import Plan
from cell.files.task import Task
from cell.preview.overlays import ExecutedMove
from cell.preview.page import Drawn, preview_page


def write_page(
    task: Task, plan: Plan, path: Path, unit: Unit | None = None, executed: Sequence[ExecutedMove] = ()
) -> None:
    """Write the page of a plan.

    Args:
        task: with the cell of the plan.
        plan: to show.
        path: of the page.
        unit: in whose counts the executed motion is; default: the cell's.
        executed: drawn over the plan.

    Raises:
        InputError: the plan does not fit the cell, or the file cannot be written.
    """
    write_atomic(path, plan_page(task, plan, unit=unit, executed=executed))


def plan_page(
    task: Task,
    plan: Plan,
    live: str | None = None,
    unit: Unit | None = None,
    executed: Sequence[ExecutedMove] = (),
) -> str:
    """Return the page of a plan as HTML text.

    Args:
        task, plan, unit, executed: see `write_page`.
        live: unique mark of a page that follows the state of its server; see `cell.live.state.LiveState.follow`.

    Raises:
        InputError: the plan does not fit the cell.
    """
    cell = task.cell
    arms = cell.robot(), cell.robot(cell.cube_size)
    drawn: Drawn = {"boards": cell.boards, "dictionary": cell.dictionary, "camera": cell.camera}
    drawn["executed"] = executed
    return preview_page(plan, *arms, unit or cell.unit, live=live, **drawn)
