"""Budgets of a plan's placements: which ones there are, what is refused, and what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import GripperStep, Plan
from arm.se3 import inverse
from cell.accuracy.budget_report import budget_to_json, budget_words, print_budgets
from cell.accuracy.error_model import ErrorModel
from cell.accuracy.placement import gripper_positions
from cell.accuracy.plan_budgets import plan_budgets, pocket_fit, require_placements
from cell.config.cell import Cell
from cell.console import Console
from cell.files.task import Task, read_task
from vision.observation import Observation


def _less_exact(cell: Cell, following_deg: float) -> Cell:
    return replace(cell, following_error=np.radians(following_deg))


def test_every_cube_has_a_budget_with_its_holes(task: Task, seen: Observation, plan: Plan) -> None:
    budgets = require_placements(task.cell, seen, plan)
    moved = [(c["cube"], c["from"], c["to"]) for c in plan.task["cubes"]]
    assert [(b.cube, b.source, b.target) for b in budgets] == moved
    for budget in budgets:
        assert 0.1e-3 < budget.sideways < 0.6e-3
        assert budget.insertion > 0.999


def test_cubes_that_are_not_moved_from_hole_to_hole_have_none(
    task: Task, seen: Observation, plan: Plan
) -> None:
    cubes = [{**c, "to": "table/1"} if n == 0 else c for n, c in enumerate(plan.task["cubes"])]
    budgets = plan_budgets(task.cell, seen, replace(plan, task={**plan.task, "cubes": cubes}))
    assert [b.cube for b in budgets] == [c["cube"] for c in cubes[1:]]
    held = tuple(
        s for s in plan.steps if not (isinstance(s, GripperStep) and s.cube == 1 and s.action == "close")
    )
    budgets = plan_budgets(
        task.cell, seen, replace(plan, steps=held)
    )  # as a plan that begins with a cube in the jaws
    assert [b.cube for b in budgets] == [c["cube"] for n, c in enumerate(plan.task["cubes"]) if n != 1]
    q_grip = gripper_positions(task.cell, plan)[1, "close"]
    known = plan_budgets(task.cell, seen, replace(plan, steps=held), {1: q_grip})
    whole = plan_budgets(task.cell, seen, plan)
    assert [(b.cube, b.sideways, b.insertion) for b in known] == [
        (b.cube, b.sideways, b.insertion) for b in whole
    ]


def test_the_jaws_move_over_the_holes_in_the_calibrated_arms_configurations(
    task: Task, seen: Observation, plan: Plan
) -> None:
    """With the encoders' own zeros, 0.3 deg off, the tool would be millimetres beside."""
    model = ErrorModel.of(task.cell)
    at = gripper_positions(task.cell, plan)
    holes = {hole.name: hole.T_base_hole for pose in seen.poses for hole in pose.holes}
    for number, cube in enumerate(plan.task["cubes"]):
        for action, place in (("close", cube["from"]), ("open", cube["to"])):
            T_hole_tool = inverse(holes[place]) @ model.T_base_tool(at[number, action])
            assert np.abs(T_hole_tool[:2, 3]).max() < 1e-4
            assert T_hole_tool[2, 2] == pytest.approx(-1.0, abs=1e-5)


def test_a_cube_that_may_miss_its_pocket_is_refused_with_its_largest_source(
    task: Task, seen: Observation, plan: Plan
) -> None:
    with pytest.raises(ImpossibleError) as refused:
        require_placements(_less_exact(task.cell, 0.08), seen, plan)
    text = str(refused.value)
    assert "accuracy.least_insertion is 0.997" in text
    assert "due to following; no single measure reaches that" in text
    assert refused.value.data["insertion"] < 0.997
    assert refused.value.data["hole"] in {c["to"] for c in plan.task["cubes"]}
    allowed = replace(_less_exact(task.cell, 0.08), least_insertion=0.5)
    assert (
        min(b.insertion for b in require_placements(allowed, seen, plan)) == refused.value.data["insertion"]
    )


def test_no_measure_is_offered_after_which_the_plan_has_too_little_clearance(
    task: Task, seen: Observation, plan: Plan
) -> None:
    cell = replace(task.cell, tool_tolerance=2.5e-3)
    with pytest.raises(ImpossibleError, match="measure where the finger tips are") as refused:
        require_placements(cell, seen, plan)
    assert refused.value.data["insertion_then"] >= cell.least_insertion
    with pytest.raises(ImpossibleError, match="no single measure reaches that and keeps the clearances"):
        require_placements(replace(cell, erring_clearance=0.1), seen, plan)


def test_a_cell_without_calibration_has_no_budgets_and_says_so(
    seen: Observation, plan: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    ideal = read_task(data_file("scenes/task2.toml")).cell
    assert require_placements(ideal, seen, plan) == ()
    with pytest.raises(ImpossibleError, match=r"cell.toml has no calibration.*a465 calibrate hand-eye"):
        plan_budgets(ideal, seen, plan)
    print_budgets((), Console())
    assert "not known" in capsys.readouterr().out
    assert budget_words(()) == ""


def test_what_is_said_is_what_was_found(
    task: Task, seen: Observation, plan: Plan, capsys: pytest.CaptureFixture[str]
) -> None:
    cell = _less_exact(task.cell, 0.05)
    budgets = plan_budgets(cell, seen, plan)
    print_budgets(budgets, Console())
    page = capsys.readouterr().out
    worst = min(budgets, key=lambda b: b.insertion)
    assert f"{100.0 * worst.insertion:.2f}" in page
    assert f"{1e3 * worst.sideways:.2f} mm" in budget_words(budgets)
    assert "following" in page
    for budget in budgets:
        told = budget_to_json(budget)
        assert np.sqrt(np.trace(np.array(told["covariance"])[:2, :2])) == pytest.approx(
            1e-3 * told["sideways_mm"]
        )
        assert sum(source["share"] for source in told["sources"].values()) == pytest.approx(1.0)


def test_sizes_are_those_of_the_cell_file(task: Task) -> None:
    fit = pocket_fit(replace(task.cell, cube_size=0.0401, cube_tolerance=3e-4, pocket_tolerance=4e-4))
    assert (fit.cube, fit.mouth, fit.sigma) == (0.0401, task.cell.boards[0].pocket[0], pytest.approx(2.5e-4))
