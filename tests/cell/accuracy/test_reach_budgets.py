"""Budgets before there is a plan: of every free target, for the cube that would enter it least certainly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cell.accuracy.placement import PlacementBudget
from cell.accuracy.plan_budgets import plan_budgets
from cell.accuracy.reach_budgets import reach_budgets
from cell.config.cell import Cell
from cell.files.task import Task
from cell.task.planning import Rest, plan_rest
from plan.cartesian.reachability import ReachTable
from vision.observation import Observation


def _budgets(
    task: Task, seen: Observation, table: ReachTable, cell: Cell | None = None
) -> tuple[PlacementBudget, ...]:
    return reach_budgets(cell or task.cell, seen, task.from_board, task.to_board, table)


def test_every_free_hole_has_the_budget_of_its_least_certain_cube(
    task: Task, seen: Observation, table: ReachTable
) -> None:
    cell = replace(task.cell, following_error=np.radians(0.05))
    every = _budgets(task, seen, table, cell)
    assert [b.target for b in every] == ["03-04/1", "03-04/2", "03-04/3", "03-04/4"]
    for cube in range(1, 5):  # with one cube alone, no hole is less certain than with all four
        states = {f"01-02/{n}": "cube" if n == cube else "empty" for n in range(1, 5)}
        alone = _budgets(task, seen.with_states(states), table, cell)  # type: ignore[arg-type]
        assert {b.source for b in alone} == {f"01-02/{cube}"}
        assert all(a.insertion >= b.insertion for a, b in zip(alone, every, strict=True))


def test_a_taken_or_unreached_hole_has_none(task: Task, seen: Observation, table: ReachTable) -> None:
    taken = seen.with_states({"03-04/2": "cube"})
    assert [b.target for b in _budgets(task, taken, table)] == ["03-04/1", "03-04/3", "03-04/4"]
    failing = tuple(
        replace(hole, choices=tuple(c for c in hole.choices if not c.ok)) if hole.hole == "03-04/3" else hole
        for hole in table.holes
    )
    assert [b.target for b in _budgets(task, seen, ReachTable(failing))] == ["03-04/1", "03-04/2", "03-04/4"]
    near = tuple(hole for hole in table.holes if hole.hole != "03-04/4")
    assert [b.target for b in _budgets(task, seen, ReachTable(near))] == ["03-04/1", "03-04/2", "03-04/3"]


def test_it_foresees_what_the_plan_has(task: Task, seen: Observation, table: ReachTable) -> None:
    plan = plan_rest(Rest(task, seen, task.cell.q_start, 0.5))
    assert plan is not None
    foreseen = {b.target: b.sideways for b in _budgets(task, seen, table)}
    for budget in plan_budgets(task.cell, seen, plan):
        assert budget.sideways == pytest.approx(foreseen[budget.target], rel=0.3)


def test_without_calibration_or_pockets_there_are_none(
    task: Task, seen: Observation, table: ReachTable
) -> None:
    assert _budgets(task, seen, table, replace(task.cell, calibration=None)) == ()
    assert reach_budgets(task.cell, seen, task.from_board, None, table) == ()
    assert _budgets(task, replace(seen, boards=seen.boards[:1]), table) == ()
