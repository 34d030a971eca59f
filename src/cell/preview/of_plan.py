"""The preview page and the live page of a plan, with the boards and the camera of the cell file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.io.storage import write_atomic
from arm.plan_file import Plan
from arm.robot.model import Robot
from cell.accuracy.budget_report import HEADER, budget_rows
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.picture import budget_pictures
from cell.accuracy.placement import PlacementBudget
from cell.accuracy.plan_budgets import pocket_fit
from cell.config.cell import Cell
from cell.files.task import Task
from cell.preview.overlays import ExecutedMove
from cell.preview.page import Accuracy, Drawn, preview_page
from cell.report.html import Table
from vision.camera.model import Image


def write_page(
    task: Task,
    plan: Plan,
    path: Path,
    budgets: Sequence[PlacementBudget] = (),
    photograph: Image | None = None,
    unit: Unit | None = None,
    executed: Sequence[ExecutedMove] = (),
) -> None:
    """Write the page of a plan.

    Args:
        task: with the cell of the plan.
        plan: to show.
        path: of the page.
        budgets: of its placements.
        photograph: of the cell, shown over what the camera sees.
        unit: in whose counts the executed motion is; default: the cell's.
        executed: drawn over the plan.

    Raises:
        InputError: the plan does not fit the cell, the photograph is not of its camera, or the file cannot be written.
    """
    write_atomic(path, plan_page(task, plan, None, budgets, photograph, unit, executed))


def plan_page(
    task: Task,
    plan: Plan,
    live: str | None = None,
    budgets: Sequence[PlacementBudget] = (),
    photograph: Image | None = None,
    unit: Unit | None = None,
    executed: Sequence[ExecutedMove] = (),
) -> str:
    """Return the page of a plan as HTML text.

    Args:
        task, plan, budgets, photograph, unit, executed: see `write_page`.
        live: unique mark of a page that follows the state of its server; see `cell.live.state.LiveState.follow`.

    Raises:
        InputError: the plan does not fit the cell, or the photograph is not of its camera.
    """
    cell = task.cell
    arms = cell.robot(), cell.robot_holding()
    drawn: Drawn = {"boards": cell.boards, "dictionary": cell.dictionary, "camera": cell.camera}
    drawn |= {"executed": executed, "photograph": photograph}
    drawn["erring"] = _erring(cell, plan, arms)
    boards = budget_pictures(cell.boards, budgets, pocket_fit(cell))
    accuracy = Accuracy(Table(HEADER, budget_rows(budgets)), boards) if budgets else None
    return preview_page(plan, *arms, unit or cell.unit, live=live, accuracy=accuracy, **drawn)


def _erring(cell: Cell, plan: Plan, arms: tuple[Robot, Robot]) -> tuple[float, ...]:
    """Clearances with errors, whatever they are; none for a plan of another arm, or one whose steps do not hold."""
    if [plan.scene.get(key) for key in ("robot_open", "robot_holding")] != [arm.digest for arm in arms]:
        return ()
    first = next(iter(plan.moves), None)
    try:
        shown = replace(cell, erring_clearance=-np.inf)
        return erring_clearances(shown, plan, begins_with=None if first is None else first.held)
    except ImpossibleError:  # `check` and `execute` refuse such a plan; the page shows it
        return ()
