"""A measure is offered if, and only if, the budget says that it suffices alone; the best of them is named."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.poses import BoardPose
from arm.se3 import transform
from cell.accuracy.measures import (
    Budgets,
    Measure,
    best_measure,
    enough_photographs,
    least_insertion,
    require_insertion,
)
from cell.accuracy.placement import PlacementBudget, Source
from cell.accuracy.plan_budgets import require_placements
from cell.accuracy.reach_budgets import reach_budgets
from cell.config.cell import Cell
from cell.files.task import Task
from cell.task.planning import Rest, plan_otherwise, plan_rest
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
    budgets = require_insertion(task.cell, _look(task), Budgets(partial(_budgets, task, table)))
    assert [(b.source, b.target) for b in budgets] == [("01-02/3", "03-04/3")]
    assert least_insertion(budgets) > task.cell.least_insertion
    assert least_insertion(()) == 1.0


def test_noise_of_the_look_is_cured_by_more_images(task: Task, table: ReachTable) -> None:
    budgets, seen = Budgets(partial(_budgets, task, table)), _noisy(task, 0.55)
    with pytest.raises(ImpossibleError, match="is due to detection; look with 20 images") as refused:
        require_insertion(task.cell, seen, budgets)
    data = refused.value.data
    assert data["insertion"] < 0.997 <= data["insertion_then"]
    measure = best_measure(task.cell, seen, budgets, task.cell.least_insertion)
    assert measure is not None
    assert measure.insertion == data["insertion_then"]
    assert measure.words == data["measure"]
    assert data["photographs"] == 20  # for a run that takes them by itself
    # a quarter of the noise's variance, which five images may have underestimated by one standard deviation
    variance = (1.0 + np.sqrt(2.0 / 4.0)) / 4.0
    really = least_insertion(budgets.of(task.cell, _noisy(task, 0.55 * np.sqrt(variance))))
    assert really == pytest.approx(measure.insertion, abs=1e-3)


def test_the_fewest_images_that_suffice_are_asked_for(task: Task, table: ReachTable) -> None:
    budgets = Budgets(partial(_budgets, task, table))
    counts = []
    for noise in (0.45, 0.55, 0.7, 1.0):
        measure = best_measure(task.cell, _noisy(task, noise), budgets, 0.997)
        assert measure is not None
        counts.append(int(measure.words.split()[2]))
    assert counts == [10, 20, 40, 80]
    many = replace(task.cell, photographs=60)
    assert best_measure(many, _noisy(task, 0.9), budgets, 0.997) is None  # the key allows 100


def test_of_several_measures_that_suffice_the_best_is_named(task: Task, table: ReachTable) -> None:
    """With noise of the look, more images help more than more poses or exact sizes, which suffice here too."""
    measure = best_measure(task.cell, _noisy(task, 0.6), Budgets(partial(_budgets, task, table)), 0.9)
    assert measure is not None
    assert measure.words.startswith("look with 10 images")


def test_images_that_do_not_suffice_are_not_taken(task: Task, table: ReachTable) -> None:
    budgets = Budgets(partial(_budgets, task, table))
    with pytest.raises(ImpossibleError) as refused:
        require_insertion(task.cell, _noisy(task, 0.1, rest_mm=0.9), budgets)
    assert "photographs" not in refused.value.data


def test_a_measure_that_leaves_too_little_clearance_is_not_offered(task: Task, table: ReachTable) -> None:
    """The plan would be refused for its clearance next, whatever the cubes' chances are."""
    of, seen = partial(_budgets, task, table), _noisy(task, 0.45)

    def clear_with(noise: float) -> Budgets:
        """Clearances hold if the look's noise is at most so much of what it was."""
        before = float(np.trace(seen.boards[0].pose.repeatability))
        return Budgets(
            of, keeps=lambda _, look: float(np.trace(look.boards[0].pose.repeatability)) <= noise * before
        )

    counts = []
    for noise in (1.0, 0.35, 0.18, 0.0):
        measure = best_measure(task.cell, seen, clear_with(noise), 0.997)
        counts.append(0 if measure is None else int(measure.words.split()[2]))
        assert enough_photographs(task.cell, seen, clear_with(noise)) == (counts[-1] or None)
    assert counts[0] == 10
    assert counts == sorted(counts[:3]) + [0]
    assert counts[2] > counts[1] > counts[0]
    with pytest.raises(
        ImpossibleError, match="no single measure reaches that and keeps the clearances"
    ) as refused:
        require_insertion(task.cell, seen, clear_with(0.0))
    assert not {"measure", "photographs"} & refused.value.data.keys()


def test_a_weak_calibration_is_cured_by_more_poses(task: Task, table: ReachTable) -> None:
    made = task.cell.calibration
    assert made is not None
    assert made.covariance is not None
    scatter = 0.3 * np.asarray(made.scatter)
    cell = replace(task.cell, calibration=replace(made, covariance=300.0 * made.covariance, scatter=scatter))
    with pytest.raises(ImpossibleError, match=r"calibrate camera and arm with \d+ poses instead of 24"):
        require_insertion(cell, _look(task), Budgets(partial(_budgets, task, table)))


def test_a_tool_that_nobody_measured_is_measured(task: Task, table: ReachTable) -> None:
    with pytest.raises(ImpossibleError, match=r"due to tool; measure where the finger tips are, to 0\.05 mm"):
        require_insertion(
            replace(task.cell, tool_tolerance=2.5e-3), _look(task), Budgets(partial(_budgets, task, table))
        )


def test_sizes_that_nobody_measured_are_measured(task: Task, table: ReachTable) -> None:
    cell = replace(task.cell, pocket_tolerance=4e-3)
    with pytest.raises(ImpossibleError, match=r"; measure cubes and pockets, to 0\.05 mm"):
        require_insertion(cell, _look(task), Budgets(partial(_budgets, task, table)))


def test_an_arm_that_scatters_is_helped_by_nothing_here(task: Task, table: ReachTable) -> None:
    cell = replace(task.cell, following_error=np.radians(0.1))
    with pytest.raises(
        ImpossibleError, match=r"no single measure reaches that and keeps .*: following has"
    ) as refused:
        require_insertion(cell, _look(task), Budgets(partial(_budgets, task, table)))
    assert "measure" not in refused.value.data


def _placement(hole: str, insertion: float) -> PlacementBudget:
    return PlacementBudget("cube 01-02/1", "01-02/1", hole, np.eye(6), {"tool": Source(1e-3, 1.0)}, insertion)


def _by_hole(insertions: dict[int, float], cubes: int, refused: list[frozenset[str]]) -> Budgets:
    """Budgets of a planner that takes the first free holes."""

    def of(without: frozenset[str]) -> tuple[PlacementBudget, ...]:
        left = [f"03-04/{n}" for n in insertions if f"03-04/{n}" not in without][:cubes]
        if len(left) < cubes:
            refused.append(without)
            raise ImpossibleError("too few holes")
        return tuple(_placement(hole, insertions[int(hole[-1])]) for hole in left)

    return Budgets(lambda cell, seen: of(frozenset()), lambda seen, without: of(without))


def test_a_hole_that_is_entered_uncertainly_is_left_out(task: Task, seen: Observation) -> None:
    refused: list[frozenset[str]] = []
    budgets = _by_hole({1: 0.9, 2: 0.998, 3: 0.9, 4: 0.9985}, 2, refused)
    measure = best_measure(task.cell, seen, budgets, 0.997)
    assert measure == Measure("put the cubes into other holes of board 03-04 (to_holes = [2, 4])", 0.998)
    assert not refused


def test_before_there_is_a_plan_as_few_holes_as_needed_are_left_out(task: Task, seen: Observation) -> None:
    """The budgets of a look are those of every hole that may be used, so more than of cubes."""
    insertions = {1: 0.9, 2: 0.998, 3: 0.9985, 4: 0.999}

    def of(without: frozenset[str]) -> tuple[PlacementBudget, ...]:
        return tuple(
            _placement(f"03-04/{n}", p) for n, p in insertions.items() if f"03-04/{n}" not in without
        )

    budgets = Budgets(lambda cell, look: of(frozenset()), lambda look, without: of(without))
    measure = best_measure(task.cell, seen, budgets, 0.997)
    assert measure == Measure("put the cubes into other holes of board 03-04 (to_holes = [2, 3, 4])", 0.998)


def test_no_other_holes_are_offered_if_there_are_too_few_good_ones(task: Task, seen: Observation) -> None:
    refused: list[frozenset[str]] = []
    assert (
        best_measure(task.cell, seen, _by_hole({1: 0.9, 2: 0.998, 3: 0.9, 4: 0.99}, 2, refused), 0.997)
        is None
    )
    assert (
        best_measure(task.cell, seen, _by_hole(dict.fromkeys((1, 2, 3, 4), 0.9), 4, refused), 0.997) is None
    )
    assert frozenset(f"03-04/{n}" for n in (1, 2, 3, 4)) in refused


@pytest.mark.slow
def test_other_holes_are_tried_by_planning_and_the_task_file_then_says_so(
    task: Task, seen: Observation
) -> None:
    """Of two cubes, the pair of holes decides: the task is planned for it, and planned so it is as certain."""
    nowhere = task.cell.zone.at(transform(t=(5.0, 0.0, 0.0)))  # so that boards stay where they are
    cell = replace(task.cell, following_error=np.radians(0.05), least_insertion=0.9925, zone=nowhere)
    left = seen.with_states({"01-02/1": "empty", "01-02/2": "empty"})
    rest = Rest(replace(task, cell=cell), left, cell.q_start, 0.5)
    plan = plan_otherwise(rest, left, {"03-04/1", "03-04/2"})
    with pytest.raises(ImpossibleError, match="of board 03-04") as refused:
        require_placements(cell, left, plan, partial(plan_otherwise, rest))
    assert {cube["to"] for cube in plan.task["cubes"]} == {"03-04/3", "03-04/4"}
    holes = re.search(r"to_holes = \[(\d), (\d)\]", refused.value.data["measure"])
    assert holes is not None
    chosen = replace(rest.task, to_holes=(int(holes[1]), int(holes[2])))
    done = plan_rest(replace(rest, task=chosen))
    assert done is not None
    then = require_placements(cell, left, done)
    assert (
        least_insertion(then)
        == refused.value.data["insertion_then"]
        >= 0.9925
        > refused.value.data["insertion"]
    )


def test_boards_that_stand_higher_are_planned_anew(task: Task, seen: Observation) -> None:
    asked: list[tuple[float, frozenset[str]]] = []

    def again(look: Observation, without: frozenset[str]) -> tuple[PlacementBudget, ...]:
        up = float((look.poses[0].T_base_board - seen.poses[0].T_base_board)[2, 3])
        asked.append((round(up, 3), without))
        return (_placement("03-04/1", 0.98 + up),)

    taken = seen.with_states({f"03-04/{n}": "cube" for n in (1, 2, 3, 4)})
    budgets = Budgets(lambda cell, look: (_placement("03-04/1", 0.98),), again)
    measure = best_measure(task.cell, taken, budgets, 0.997)
    assert measure is not None
    assert measure.words == "put boards 01-02 and 03-04 on stands 30 mm higher, nearer to the camera"
    assert measure.insertion == pytest.approx(1.01)
    assert asked == [(0.0, frozenset()), (0.03, frozenset())]


def test_what_needs_other_grasps_is_not_tried_if_something_simpler_makes_it_certain(
    task: Task, seen: Observation
) -> None:
    def again(look: Observation, without: frozenset[str]) -> tuple[PlacementBudget, ...]:
        raise AssertionError

    of = lambda cell, look: (_placement("03-04/1", 0.9 if cell.tool_tolerance > 1e-4 else 1.0),)  # noqa: E731
    measure = best_measure(task.cell, seen, Budgets(of, again), 0.997)
    assert measure is not None
    assert measure.words.startswith("measure where the finger tips are")


def test_more_images_suffice_for_noise_that_is_known_from_few(task: Task, table: ReachTable) -> None:
    """Two images say less of the noise than five do, so more than the estimate needs are asked for."""
    budgets, counts = Budgets(partial(_budgets, task, table)), []
    for photographs in (2, 5, 30):
        measure = best_measure(replace(task.cell, photographs=photographs), _noisy(task, 0.5), budgets, 0.997)
        assert measure is not None
        counts.append(int(measure.words.split()[2]) / photographs)
    assert counts == [4, 4, 2]
