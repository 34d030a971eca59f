"""The error budgets of placements that no plan has chosen yet: of every free target, with the best grasps in reach."""

from __future__ import annotations

from arm.board import Board
from cell.accuracy.error_model import ErrorModel
from cell.accuracy.placement import PlacementBudget, Transfer, placement_budget
from cell.accuracy.plan_budgets import pocket_fit
from cell.config.cell import Cell
from plan.cartesian.reachability import ReachTable
from vision.observation import Observation


def reach_budgets(
    cell: Cell, seen: Observation, from_board: Board, to_board: Board | None, table: ReachTable
) -> tuple[PlacementBudget, ...]:
    """Return one budget per free hole of the target board in reach: for the cube that would enter it least certainly.

    Args:
        cell: the cell; without a calibration there are no budgets.
        seen: observation of both boards.
        from_board, to_board: of the task; without a target board there are no pockets and no budgets.
        table: reach of the holes that the task uses. A plan may choose other grasps; the budget depends little on them.
    """
    source = seen.board(from_board.name)
    target = None if to_board is None else seen.board(to_board.name)
    if source is None or target is None or not ErrorModel.available(cell):
        return ()
    model, fit = ErrorModel.of(cell), pocket_fit(cell)
    taken, put = model.board(source.pose), model.board(target.pose)
    best = {reach.hole: reach.best.q_hole for reach in table.holes if reach.ok}
    cubes = [hole for hole in source.holes("cube", "unsure") if hole.name in best]
    found = []
    for hole in (hole for hole in target.holes("empty") if hole.name in best):
        budgets = [
            placement_budget(
                model,
                Transfer(
                    f"cube {cube.name}",
                    (taken, cube.index),
                    (put, hole.index),
                    best[cube.name],
                    best[hole.name],
                ),
                fit,
            )
            for cube in cubes
        ]
        if budgets:
            found.append(min(budgets, key=lambda b: (b.insertion, -b.sideways)))
    return tuple(found)
