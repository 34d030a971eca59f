"""The error budgets of a plan's placements, and the refusal of one that is too unlikely to succeed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from arm.board import TOLERANCE_SDS
from arm.errors import ImpossibleError
from arm.plan_file import GripperStep, Move, Plan
from arm.se3 import Array
from cell.accuracy.entering import Fit
from cell.accuracy.error_model import BoardError, ErrorModel
from cell.accuracy.placement import PlacementBudget, Transfer, placement_budget
from cell.config.cell import Cell
from vision.observation import Observation


def plan_budgets(cell: Cell, seen: Observation, plan: Plan) -> tuple[PlacementBudget, ...]:
    """Return the budget of every cube that the plan moves from a hole of a detected board to another.

    Args:
        cell: with a calibration.
        seen: observation that the plan was made from.
        plan: of a task of this cell.

    Raises:
        ImpossibleError: the cell has no calibration with a covariance.
    """
    model = ErrorModel.of(cell)
    boards = {pose.board.name: model.board(pose) for pose in seen.poses}
    return tuple(
        placement_budget(model, transfer, fit_of(cell)) for transfer in _transfers(cell, boards, plan)
    )


def certain_placements(cell: Cell, seen: Observation, plan: Plan) -> tuple[PlacementBudget, ...]:
    """Return the budgets of a plan's placements; empty if the cell is not calibrated, so that no error is known.

    Raises:
        ImpossibleError: a cube is too likely to miss its pocket; see `require_entering`.
    """
    if not ErrorModel.known(cell):
        return ()
    budgets = plan_budgets(cell, seen, plan)
    require_entering(budgets, cell.least_entering)
    return budgets


def fit_of(cell: Cell) -> Fit:
    """What has to fit where a cube enters a pocket of this cell."""
    sigma = np.hypot(cell.cube_tolerance, cell.pocket_made) / TOLERANCE_SDS
    return Fit(cell.cube_size, cell.boards[0].pocket[0], float(sigma))


def require_entering(budgets: Sequence[PlacementBudget], least: float) -> None:
    """Require that every cube enters its pocket with a probability of at least `least`.

    Raises:
        ImpossibleError: names the least likely placement, its error and the largest source; data: cube, hole, entering,
            sideways_mm, sources_mm.
    """
    worst = min(budgets, key=lambda b: b.entering, default=None)
    if worst is None or worst.entering >= least:
        return
    source, largest = next(iter(worst.sources.items()))
    raise ImpossibleError(
        f"{worst.cube} enters {worst.target} with a probability of {100.0 * worst.entering:.1f} %, but "
        f"accuracy.least_entering is {least:g}: the standard deviation of its place in the plate is "
        f"{1e3 * worst.sideways:.2f} mm, and {100.0 * largest.part:.0f} % of the variance is due to {source}",
        cube=worst.cube,
        hole=worst.target,
        entering=worst.entering,
        sideways_mm=1e3 * worst.sideways,
        sources_mm={name: 1e3 * part.sideways for name, part in worst.sources.items()},
    )


def _transfers(cell: Cell, boards: Mapping[str, BoardError], plan: Plan) -> Iterator[Transfer]:
    at = _gripper_positions(cell, plan)
    for number, cube in enumerate(plan.task["cubes"]):
        source, target = (_hole(boards, cube[key]) for key in ("from", "to"))
        if source is not None and target is not None and {(number, "close"), (number, "open")} <= at.keys():
            yield Transfer(cube["cube"], source, target, at[number, "close"], at[number, "open"])


def _gripper_positions(cell: Cell, plan: Plan) -> dict[tuple[int, str], Array]:
    """Joint positions at which the jaws close on a cube and open, by its number and "close" or "open"."""
    found: dict[tuple[int, str], Array] = {}
    counts = plan.start
    for step in plan.steps:
        if isinstance(step, Move):
            counts = step.path.end
        elif isinstance(step, GripperStep) and step.cube is not None:
            found[step.cube, step.action] = cell.unit.positions(counts)
    return found


def _hole(boards: Mapping[str, BoardError], name: str) -> tuple[BoardError, int] | None:
    """The board and index of a hole such as ``01-02/3``; None if it is no hole of a detected board."""
    board, _, number = name.rpartition("/")
    return (boards[board], int(number) - 1) if board in boards else None
