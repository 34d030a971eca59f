"""A measure is offered if, and only if, the budget says that it suffices alone; the best of them is named."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.poses import BoardPose
from cell.accuracy.measures import best_measure, least_insertion, require_insertion
from cell.accuracy.placement import PlacementBudget
from cell.accuracy.reach_budgets import reach_budgets
from cell.config.cell import Cell
from cell.files.task import Task
from plan.cartesian.reachability import ReachTable
from tasks.true_look import true_look
from vision.observation import Observation


def _look(task: Task) -> Observation:
    """One cube and one free hole."""
    taken = dict.fromkeys((f"03-04/{n}" for n in (1, 2, 4)), "cube")
    left = dict.fromkeys((f"01-02/{n}" for n in (1, 2, 4)), "empty")
    return true_look(task).with_states({**taken, **left})  # type: ignore[arg-type]


def _noisy(task: Task, noise_mm: float, rest_mm: float = 0.05) -> Observation:
    """A look whose boards have this much noise sideways, which an average lowers, and the rest, which it does not."""

    def pose(of: BoardPose) -> BoardPose:
        noise, rest = (np.diag([(1e-3 * mm) ** 2] * 2 + [1e-8] * 4) for mm in (noise_mm, rest_mm))
        return replace(of, covariance=noise + rest, repeatability=noise)

    seen = _look(task)
    return replace(seen, boards=tuple(replace(b, pose=pose(b.pose)) for b in seen.boards))


def _budgets(task: Task, table: ReachTable, cell: Cell, seen: Observation) -> tuple[PlacementBudget, ...]:
    return reach_budgets(cell, seen, task.from_board, task.to_board, table)


def test_what_is_certain_enough_is_returned(task: Task, table: ReachTable) -> None:
    budgets = require_insertion(task.cell, _look(task), partial(_budgets, task, table))
    assert [(b.source, b.target) for b in budgets] == [("01-02/3", "03-04/3")]
    assert least_insertion(budgets) > task.cell.least_insertion
    assert least_insertion(()) == 1.0


def test_noise_of_the_look_is_cured_by_more_images(task: Task, table: ReachTable) -> None:
    budgets, seen = partial(_budgets, task, table), _noisy(task, 0.55)
    with pytest.raises(ImpossibleError, match="is due to detection; look with 10 images") as refused:
        require_insertion(task.cell, seen, budgets)
    data = refused.value.data
    assert data["insertion"] < 0.997 <= data["insertion_then"]
    measure = best_measure(task.cell, seen, budgets, task.cell.least_insertion)
    assert measure is not None
    assert measure.insertion == data["insertion_then"]
    assert measure.words == data["measure"]
    # half the noise's variance, computed here
    really = least_insertion(budgets(task.cell, _noisy(task, 0.55 / np.sqrt(2.0))))
    assert really == pytest.approx(measure.insertion, abs=1e-3)


def test_the_fewest_images_that_suffice_are_asked_for(task: Task, table: ReachTable) -> None:
    budgets = partial(_budgets, task, table)
    counts = []
    for noise in (0.55, 0.7, 1.0):
        measure = best_measure(task.cell, _noisy(task, noise), budgets, 0.997)
        assert measure is not None
        counts.append(int(measure.words.split()[2]))
    assert counts == [10, 20, 40]
    many = replace(task.cell, photographs=60)
    assert best_measure(many, _noisy(task, 0.9), budgets, 0.997) is None  # the key allows 100


def test_of_several_measures_that_suffice_the_best_is_named(task: Task, table: ReachTable) -> None:
    """With noise of the look, more images help more than more poses or exact sizes, which suffice here too."""
    measure = best_measure(task.cell, _noisy(task, 0.6), partial(_budgets, task, table), 0.9)
    assert measure is not None
    assert measure.words.startswith("look with 10 images")


def test_a_weak_calibration_is_cured_by_more_poses(task: Task, table: ReachTable) -> None:
    made = task.cell.calibration
    assert made is not None
    assert made.covariance is not None
    scatter = 0.3 * np.asarray(made.scatter)
    cell = replace(task.cell, calibration=replace(made, covariance=300.0 * made.covariance, scatter=scatter))
    with pytest.raises(ImpossibleError, match=r"calibrate camera and arm with \d+ poses instead of 24"):
        require_insertion(cell, _look(task), partial(_budgets, task, table))


def test_a_tool_that_nobody_measured_is_measured(task: Task, table: ReachTable) -> None:
    with pytest.raises(ImpossibleError, match=r"due to tool; measure where the finger tips are, to 0\.05 mm"):
        require_insertion(
            replace(task.cell, tool_tolerance=2.5e-3), _look(task), partial(_budgets, task, table)
        )


def test_sizes_that_nobody_measured_are_measured(task: Task, table: ReachTable) -> None:
    cell = replace(task.cell, pocket_tolerance=4e-3)
    with pytest.raises(ImpossibleError, match=r"; measure cubes and pockets, to 0\.05 mm"):
        require_insertion(cell, _look(task), partial(_budgets, task, table))


def test_an_arm_that_scatters_is_helped_by_nothing_here(task: Task, table: ReachTable) -> None:
    cell = replace(task.cell, following_error=np.radians(0.1))
    with pytest.raises(ImpossibleError, match="no single measure reaches that: following has") as refused:
        require_insertion(cell, _look(task), partial(_budgets, task, table))
    assert "measure" not in refused.value.data
