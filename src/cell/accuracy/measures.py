"""What would make a placement certain enough: each measure is tried on the error budget before it is offered."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, combinations
from typing import Any

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import frozen
from cell.accuracy.board_moves import nearer_looks
from cell.accuracy.insertion import SURE
from cell.accuracy.placement import PlacementBudget
from cell.config.cell import Cell
from vision.observation import Observation, ObservedBoard

Holes = frozenset[str]
Again = Callable[[Observation, Holes], Sequence[PlacementBudget]]
_MORE_POSES, _MORE_PHOTOGRAPHS = (2, 4, 8), (2, 4, 8, 16)
_MOST_PHOTOGRAPHS = 100
_MEASURED = 5e-5  # m, tolerance of a length that was measured with care


@dataclass(frozen=True, eq=False)
class Budgets:
    """The budgets of a task's placements, for whatever a measure changes.

    Attributes:
        of: of the same grasps, for another cell file or another look at the same boards.
        again: of grasps that are chosen anew, for boards that stand elsewhere and without some holes of the target
            board; it raises `ImpossibleError` if there are none. None: the placements are given.
        keeps: whether the plan then keeps its clearances with errors, which a plan is asked for next.
    """

    of: Callable[[Cell, Observation], Sequence[PlacementBudget]]
    again: Again | None = None
    keeps: Callable[[Cell, Observation], bool] = lambda cell, seen: True


@dataclass(frozen=True)
class Measure:
    """A measure that was tried.

    Attributes:
        words: what to do, as an imperative.
        insertion: probability of the least certain placement after it.
        keeps: whether the plan then keeps its clearances with errors.
    """

    words: str
    insertion: float
    keeps: Callable[[], bool] = field(default=lambda: True, compare=False)


def best_measure(cell: Cell, seen: Observation, budgets: Budgets, least: float) -> Measure | None:
    """Return the measure after which every cube enters its pocket most certainly; None if none reaches `least`.

    Of the same kind (twice, four times as many photographs) the smallest counts that reaches `least`, and after which
    the plan keeps its clearances with errors: else the next refusal would be for those. What needs other
    grasps is tried last, and only if no other measure makes the placements as certain as can be stated.
    """
    best: Measure | None = None
    for kind in chain(_same_grasps(cell, seen, budgets), _other_grasps(cell, seen, budgets, least)):
        if best is not None and best.insertion > SURE:
            break
        measure = next((one for one in kind if one.insertion >= least and one.keeps()), None)
        if measure is not None and (best is None or measure.insertion > best.insertion):
            best = measure
    return best


def require_insertion(cell: Cell, seen: Observation, placements: Budgets) -> tuple[PlacementBudget, ...]:
    """Return the budgets, and require that every cube enters its pocket as certainly as the cell file asks.

    Raises:
        ImpossibleError: names the least likely placement, its error, the largest source, and the measure that would
            help most; data: cube, hole, insertion, sideways_mm, sources_mm, measure, insertion_then, and photographs:
            the number of images in a look that suffices, if there is one.
    """
    budgets, least = tuple(placements.of(cell, seen)), cell.least_insertion
    worst = min(budgets, key=lambda b: b.insertion, default=None)
    if worst is None or worst.insertion >= least:
        return budgets
    source, largest = next(iter(worst.sources.items()))
    images = enough_photographs(cell, seen, placements)
    measure = best_measure(cell, seen, placements, least)
    cure = (
        f"no single measure reaches that and keeps the clearances with errors: {source} has to become smaller"
        if measure is None
        else f"{measure.words}: then it is {100.0 * measure.insertion:.1f} %"
    )
    data: dict[str, Any] = (
        {} if measure is None else {"measure": measure.words, "insertion_then": measure.insertion}
    )
    data |= {} if images is None else {"photographs": images}
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


def enough_photographs(cell: Cell, seen: Observation, budgets: Budgets) -> int | None:
    """Return the number of images in a look that makes placements and clearances certain enough; None if none does."""
    for times, (_, other, look) in zip(_MORE_PHOTOGRAPHS, _more_photographs(cell, seen), strict=False):
        if least_insertion(budgets.of(other, look)) >= cell.least_insertion and budgets.keeps(other, look):
            return times * cell.photographs
    return None


def least_insertion(budgets: Sequence[PlacementBudget]) -> float:
    """Return the probability of the least certain placement; 1 without any."""
    return min((budget.insertion for budget in budgets), default=1.0)


_Kind = Iterator[Measure]


def _same_grasps(cell: Cell, seen: Observation, budgets: Budgets) -> Iterator[_Kind]:
    def tried(changes: Iterator[tuple[str, Cell, Observation]]) -> _Kind:
        for words, other, look in changes:
            yield Measure(
                words, least_insertion(budgets.of(other, look)), partial(budgets.keeps, other, look)
            )

    yield tried(_more_photographs(cell, seen))
    if cell.tool_tolerance > _MEASURED:
        where = f"measure where the finger tips are, to {1e3 * _MEASURED:g} mm (accuracy.tool_within_mm)"
        yield tried(iter([(where, replace(cell, tool_tolerance=_MEASURED), seen)]))
    if max(cell.cube_tolerance, cell.pocket_tolerance) > _MEASURED:
        keys = "cube.size_tolerance_mm, accuracy.pocket_within_mm"
        sizes = f"measure cubes and pockets, to {1e3 * _MEASURED:g} mm ({keys})"
        measured = replace(cell, cube_tolerance=_MEASURED, pocket_tolerance=_MEASURED)
        yield tried(iter([(sizes, measured, seen)]))
    yield tried(_more_poses(cell, seen))


def _more_photographs(cell: Cell, seen: Observation) -> Iterator[tuple[str, Cell, Observation]]:
    """The noise of corners and of the camera's sway is drawn anew in every image.

    Its variance is itself estimated from the images, so more of them have to suffice for one that is larger by a
    standard deviation of this estimate (sqrt(2 / (n - 1)) of it, if all corners of an image are off together).
    """
    noisier = noisier_by(cell.photographs)
    for times in _MORE_PHOTOGRAPHS:
        count = times * cell.photographs
        if count <= _MOST_PHOTOGRAPHS:
            boards = tuple(averaged(board, noisier / times) for board in seen.boards)
            words = f"look with {count} images (look.photographs = {count}) instead of {cell.photographs}"
            yield words, cell, replace(seen, boards=boards)


def noisier_by(photographs: int) -> float:
    """Factor by which the variance of the noise of so many images may be larger than they say."""
    return 1.0 + float(np.sqrt(2.0 / max(photographs - 1, 1)))


def averaged(board: ObservedBoard, share: float) -> ObservedBoard:
    """A board with `share` of the variance that is drawn anew in every look."""
    pose = board.pose
    if pose.repeatability is None:
        return board
    covariance = pose.covariance - (1.0 - share) * pose.repeatability
    noise = share * pose.repeatability
    return replace(board, pose=replace(pose, covariance=frozen(covariance), repeatability=frozen(noise)))


def _more_poses(cell: Cell, seen: Observation) -> Iterator[tuple[str, Cell, Observation]]:
    """The calibration's covariance falls with the number of poses; the arm's scatter stays."""
    made = cell.calibration
    poses = None if made is None else made.made.get("poses")
    if made is None or made.covariance is None or not isinstance(poses, int):
        return
    for times in _MORE_POSES:
        calibration = replace(made, covariance=frozen(made.covariance / times))
        words = f"calibrate camera and arm with {times * poses} poses instead of {poses}"
        yield words, replace(cell, calibration=calibration), seen


def _other_grasps(cell: Cell, seen: Observation, budgets: Budgets, least: float) -> Iterator[_Kind]:
    if budgets.again is None:
        return
    now, again = budgets.of(cell, seen), budgets.again
    yield _other_holes(now, seen, again, least)

    def tried(looks: Iterator[tuple[str, Observation]]) -> _Kind:
        for words, look in looks:
            if found := _tried(again, look, frozenset()):
                yield Measure(words, least_insertion(found))

    names = {_board(name) for budget in now for name in (budget.source, budget.target)}
    yield from map(tried, nearer_looks(cell, seen, names))


def _other_holes(now: Sequence[PlacementBudget], seen: Observation, again: Again, least: float) -> _Kind:
    """Leave out the holes that a cube enters too uncertainly; else choose any others, as many as now."""
    board = seen.board(_board(now[0].target)) if now else None
    if board is None:
        return
    free, used = {hole.name for hole in board.holes("empty")}, {budget.target for budget in now}
    doubtful = {budget.target for budget in now if budget.insertion < least}
    choices = [free - doubtful, *map(set, combinations(sorted(free), len(now)))]
    for chosen in choices:
        if chosen != used and (found := _tried(again, seen, frozenset(free - chosen))):
            left = sorted(int(budget.target.rpartition("/")[2]) for budget in found)
            words = f"put the cubes into other holes of board {board.name} (to_holes = {left})"
            yield Measure(words, least_insertion(found))


def _tried(again: Again, seen: Observation, without: Holes) -> Sequence[PlacementBudget]:
    """Budgets with other grasps; none if there are no such grasps."""
    try:
        return again(seen, without)
    except ImpossibleError:
        return ()


def _board(hole: str) -> str:
    return hole.rpartition("/")[0]
