"""What would make a placement certain enough: each measure is tried on the error budget before it is offered."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from arm.errors import ImpossibleError
from arm.se3 import frozen
from cell.accuracy.placement import PlacementBudget
from cell.config.cell import Cell
from vision.observation import Observation, ObservedBoard

Budgets = Callable[[Cell, Observation], Sequence[PlacementBudget]]
"""Budgets of the same placements, of a cell and an observation that a measure has changed."""

_TIMES = (2, 4, 8)  # as many photographs or poses
_MOST_PHOTOGRAPHS = 100
_MEASURED = 5e-5  # m, tolerance of a length that was measured with care


@dataclass(frozen=True)
class Measure:
    """A measure that was tried.

    Attributes:
        words: what to do, as an imperative.
        insertion: probability of the least certain placement after it.
    """

    words: str
    insertion: float


def best_measure(cell: Cell, seen: Observation, budgets: Budgets, least: float) -> Measure | None:
    """Return the measure after which every cube enters its pocket most certainly; None if none reaches `least`.

    Of the same kind (twice, four times as many photographs) the smallest that reaches `least` counts.
    """
    tried = []
    for kind in _kinds(cell, seen):
        for words, changed_cell, changed_seen in kind:
            insertion = least_insertion(budgets(changed_cell, changed_seen))
            if insertion >= least:
                tried.append(Measure(words, insertion))
                break
    return max(tried, key=lambda measure: measure.insertion, default=None)


def require_insertion(cell: Cell, seen: Observation, budgets_of: Budgets) -> tuple[PlacementBudget, ...]:
    """Return the budgets, and require that every cube enters its pocket as certainly as the cell file asks.

    Raises:
        ImpossibleError: names the least likely placement, its error, the largest source, and the measure that would
            help most; data: cube, hole, insertion, sideways_mm, sources_mm, measure, insertion_then.
    """
    budgets, least = tuple(budgets_of(cell, seen)), cell.least_insertion
    worst = min(budgets, key=lambda b: b.insertion, default=None)
    if worst is None or worst.insertion >= least:
        return budgets
    source, largest = next(iter(worst.sources.items()))
    measure = best_measure(cell, seen, budgets_of, least)
    cure = (
        f"no single measure reaches that: {source} has to become smaller"
        if measure is None
        else f"{measure.words}: then it is {100.0 * measure.insertion:.1f} %"
    )
    data: dict[str, Any] = (
        {} if measure is None else {"measure": measure.words, "insertion_then": measure.insertion}
    )
    raise ImpossibleError(
        f"{worst.cube} enters {worst.target} with a probability of {100.0 * worst.insertion:.1f} %, but "
        f"accuracy.least_insertion is {least:g}: its RMS offset from the hole's axis is {1e3 * worst.sideways:.2f} mm, "
        f"and {100.0 * largest.share:.0f} % of the variance is due to {source}; {cure}",
        cube=worst.cube,
        hole=worst.target,
        insertion=worst.insertion,
        sideways_mm=1e3 * worst.sideways,
        sources_mm={name: 1e3 * part.sideways for name, part in worst.sources.items()},
        **data,
    )


def least_insertion(budgets: Sequence[PlacementBudget]) -> float:
    """Return the probability of the least certain placement; 1 without any."""
    return min((budget.insertion for budget in budgets), default=1.0)


_Tried = tuple[str, Cell, Observation]


def _kinds(cell: Cell, seen: Observation) -> Iterator[Iterator[_Tried]]:
    yield _more_photographs(cell, seen)
    yield _more_poses(cell, seen)
    if cell.tool_tolerance > _MEASURED:
        where = f"measure where the finger tips are, to {1e3 * _MEASURED:g} mm (accuracy.tool_within_mm)"
        yield iter([(where, replace(cell, tool_tolerance=_MEASURED), seen)])
    if max(cell.cube_tolerance, cell.pocket_tolerance) > _MEASURED:
        keys = "cube.size_tolerance_mm, accuracy.pocket_within_mm"
        sizes = f"measure cubes and pockets, to {1e3 * _MEASURED:g} mm ({keys})"
        yield iter([(sizes, replace(cell, cube_tolerance=_MEASURED, pocket_tolerance=_MEASURED), seen)])


def _more_photographs(cell: Cell, seen: Observation) -> Iterator[_Tried]:
    """The noise of corners and of the camera's sway is drawn anew in every image."""
    for times in _TIMES:
        count = times * cell.photographs
        if count <= _MOST_PHOTOGRAPHS:
            boards = tuple(_averaged(board, 1.0 / times) for board in seen.boards)
            words = f"look with {count} images (look.photographs = {count}) instead of {cell.photographs}"
            yield words, cell, replace(seen, boards=boards)


def _averaged(board: ObservedBoard, share: float) -> ObservedBoard:
    pose = board.pose
    if pose.repeatability is None:
        return board
    covariance = pose.covariance - (1.0 - share) * pose.repeatability
    noise = share * pose.repeatability
    return replace(board, pose=replace(pose, covariance=frozen(covariance), repeatability=frozen(noise)))


def _more_poses(cell: Cell, seen: Observation) -> Iterator[_Tried]:
    """The calibration's covariance falls with the number of poses; the arm's scatter stays."""
    made = cell.calibration
    poses = None if made is None else made.made.get("poses")
    if made is None or made.covariance is None or not isinstance(poses, int):
        return
    for times in _TIMES:
        calibration = replace(made, covariance=frozen(made.covariance / times))
        words = f"calibrate camera and arm with {times * poses} poses instead of {poses}"
        yield words, replace(cell, calibration=calibration), seen
