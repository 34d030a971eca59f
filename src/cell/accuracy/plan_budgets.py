"""The error budgets of a plan's placements."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

import numpy as np

from arm.board import TOLERANCE_SDS
from arm.errors import ImpossibleError
from arm.plan_file import Plan
from arm.se3 import Array
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.error_model import BoardError, ErrorModel
from cell.accuracy.insertion import PocketFit
from cell.accuracy.measures import Budgets, Holes, require_insertion
from cell.accuracy.placement import PlacementBudget, Transfer, gripper_positions, hole_of, placement_budget
from cell.config.cell import Cell
from vision.observation import Observation


def plan_budgets(
    cell: Cell, seen: Observation, plan: Plan, gripped: Mapping[int, Array] | None = None
) -> tuple[PlacementBudget, ...]:
    """Return the budget of every cube that the plan moves from a hole of a detected board to another.

    Args:
        cell: with a calibration.
        seen: observation that the plan was made from.
        plan: of a task of this cell.
        gripped: joint positions (6,) rad at which the jaws closed on a cube before the plan, by the cube's number.

    Raises:
        ImpossibleError: the cell has no calibration with a covariance.
    """
    model = ErrorModel.of(cell)
    boards = {pose.board.name: model.board(pose) for pose in seen.poses}
    transfers = _transfers(cell, boards, plan, gripped or {})
    return tuple(placement_budget(model, transfer, pocket_fit(cell)) for transfer in transfers)


def require_placements(
    cell: Cell,
    seen: Observation,
    plan: Plan,
    again: Callable[[Observation, Holes], Plan] | None = None,
    gripped: Mapping[int, Array] | None = None,
) -> tuple[PlacementBudget, ...]:
    """Return the budgets of a plan's placements; empty if the cell is not calibrated, so that no error is known.

    Args:
        cell, seen, plan, gripped: see `plan_budgets`.
        again: plans the same task for boards that stand elsewhere, or without some holes of the target board, to try
            whether that would help; it raises `ImpossibleError` if there is no plan.

    Raises:
        ImpossibleError: a cube is too likely to miss its pocket; see `cell.accuracy.measures`.
    """
    if not ErrorModel.available(cell):
        return ()

    def anew(look: Observation, without: Holes) -> tuple[PlacementBudget, ...]:
        other = plan if again is None else again(look, without)
        as_many = len(other.task["cubes"]) == len(plan.task["cubes"])
        return plan_budgets(cell, look, other) if as_many and _keeps(cell, look, other) else ()

    def keeps(other: Cell, look: Observation) -> bool:
        return gripped is not None or _keeps(other, look, plan)

    same = partial(plan_budgets, plan=plan, gripped=gripped)
    return require_insertion(cell, seen, Budgets(same, None if again is None else anew, keeps))


def _keeps(cell: Cell, seen: Observation, plan: Plan) -> bool:
    """Whether a plan keeps its clearances with errors."""
    try:
        erring_clearances(cell, plan, seen)
    except ImpossibleError:
        return False
    return True


def pocket_fit(cell: Cell) -> PocketFit:
    """What has to fit where a cube enters a pocket of this cell."""
    sigma = np.hypot(cell.cube_tolerance, cell.pocket_tolerance) / TOLERANCE_SDS
    return PocketFit(cell.cube_size, cell.boards[0].pocket[0], float(sigma))


def _transfers(
    cell: Cell, boards: Mapping[str, BoardError], plan: Plan, gripped: Mapping[int, Array]
) -> Iterator[Transfer]:
    at = {(number, "close"): q for number, q in gripped.items()} | gripper_positions(cell, plan)
    for number, cube in enumerate(plan.task["cubes"]):
        source, target = (hole_of(boards, cube[key]) for key in ("from", "to"))
        if source is not None and target is not None and {(number, "close"), (number, "open")} <= at.keys():
            yield Transfer(cube["cube"], source, target, at[number, "close"], at[number, "open"])
