"""Confirm that a released cube is at its target. Only the next look can confirm it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from arm.se3 import Array, apply
from cell.config.cell import Cell
from cell.cubes.held_back import HeldBack
from cell.files.board_shift import board_shift
from cell.files.task import Task
from cell.report.cubes import CubeRow
from cell.scene.build import T_base_on_table
from cell.scene.displaced import BESIDE
from vision.observation import Observation
from vision.occupancy.cube_top import CubeTop, EmptyPlace
from vision.occupancy.seated import CubeWidth, Seating, Sight, seating, width_of

_NO_IMAGES = Seating("unsure", "there are no images to measure it in")
NOT_CONFIRMED = "not confirmed"
OUT_OF_VIEW = "is out of the camera's view"


@dataclass(frozen=True)
class Unconfirmed:
    """Why a cube is not confirmed.

    Attributes:
        reasons: one line each.
        lost: its position may be unknown, so the arm must not move on.
    """

    reasons: tuple[str, ...]
    lost: bool


def confirm(
    task: Task,
    before: Observation,
    after: Observation,
    source: str,
    target: str,
    width: CubeWidth | None,
    empty: Observation | None = None,
) -> Unconfirmed | None:
    """Return None if a cube certainly moved from source to target, and the target's board did not move.

    The look before shows the target without the cube, and the look after shows the source without it. So either look
    serves as the reference image of an empty place in the other.

    Args:
        task: of the cube.
        before: the last look with the cube at its source.
        after: the look that must show the cube at its target.
        source, target: names of the places; the source may be beside a hole (`cell.scene.displaced`).
        width: of the cube, if it was measured before; None: the cell file's.
        empty: the last look with an empty target; None: `before`.
    """
    reasons, source = [], source.removeprefix(BESIDE)
    state = "empty" if _on_table(task, source) else after.state(source)  # a look says nothing of table places
    if source != target and state != "empty":
        reasons.append(f"hole {source} looks {state or 'hidden'}, not empty")
    lost = bool(reasons)
    on_table = _on_table(task, target)
    if on_table and not _in_view(task, after, target):
        return Unconfirmed((*reasons, f"{target} {OUT_OF_VIEW}"), lost)
    state = "cube" if on_table else after.state(target)
    if state != "cube":
        reasons.append(f"hole {target} looks {state or 'hidden'}, not cube")
    seat = seated(task, after, target, width, empty or before)
    if seat.state != "seated":
        reasons.append(f"the cube in {target} is not certainly seated: {seat.reason}")
    if reasons:
        return Unconfirmed(tuple(reasons), True)
    board = target.rpartition("/")[0]
    old, new = before.board(board), after.board(board)
    if old is not None and new is not None:
        shift = board_shift(old.pose.board, task.cell.cube_size, old.pose.T_base_board, new.pose.T_base_board)
        if shift.beyond(task.cell):
            return Unconfirmed((f"board {board} moved by {shift} during the transfer",), False)
    return None


def seated(
    task: Task,
    observation: Observation,
    place: str,
    width: CubeWidth | None = None,
    without: Observation | None = None,
) -> Seating:
    """Judge from the size and position of its top whether a cube is seated. `without`: a look at the empty place."""
    if not observation.images:
        return _NO_IMAGES
    return seating(_top(task, observation, place, without), width or nominal_width(task.cell))


def width_at(
    task: Task, observation: Observation, place: str, without: Observation | None = None
) -> CubeWidth | None:
    """Measure the width of the cube at a place; None without images, or if they do not determine it."""
    return width_of(_top(task, observation, place, without), nominal_width(task.cell))


def nominal_width(cell: Cell) -> CubeWidth:
    """Width of an unmeasured cube: the cell file's, within its tolerance (two standard deviations)."""
    return CubeWidth(cell.cube_size, cell.cube_tolerance / 2.0)


def unseen_places(task: Task, observation: Observation, places: Iterable[str]) -> str:
    """Return a warning that names the places on the table that are out of view; empty if there are none."""
    if task.places is None or not observation.images:
        return ""
    hidden = [place for place in places if not _in_view(task, observation, place)]
    if not hidden:
        return ""
    return (
        f"out of the camera's view: {', '.join(hidden)}; no look can confirm a cube there, so the run will end as "
        "not confirmed; choose places in view in the task file"
    )


def T_base_of(task: Task, observation: Observation, place: str) -> Array | None:
    """Observed pose of a hole, or the pose of a place on the table; None for a hole whose board was not found."""
    if _on_table(task, place):
        return T_base_on_table(task, place)
    name, _, number = place.rpartition("/")
    board = observation.board(name)
    return None if board is None else board.pose.holes[int(number) - 1].T_base_hole


def _top(task: Task, observation: Observation, place: str, without: Observation | None) -> CubeTop | None:
    """Measure the top of the cube at a place; None if that is not possible."""
    T_base_place, sight = T_base_of(task, observation, place), _sight(task, observation)
    if sight is None or T_base_place is None:
        return None
    empty = None if without is None else _empty(task, without, place)
    return (sight.on_plane if _on_table(task, place) else sight.in_hole)(T_base_place, empty)


def _empty(task: Task, observation: Observation, place: str) -> EmptyPlace | None:
    """The image of a place from a look at which it was certainly empty; otherwise None."""
    T_base_place, sight = T_base_of(task, observation, place), _sight(task, observation)
    shown = _on_table(task, place) or observation.state(place) == "empty"
    if sight is None or T_base_place is None or place in observation.moved_since or not shown:
        return None
    return sight.empty(T_base_place)


def _sight(task: Task, observation: Observation) -> Sight | None:
    """The images of an observation, for measuring cubes; None if it has none."""
    if not observation.images:
        return None
    cell = task.cell
    return Sight(observation.images, cell.camera, nominal_width(cell), cell.boards[0].pocket)


def _on_table(task: Task, place: str) -> bool:
    return place.startswith("table/") and task.to_board is None


def _in_view(task: Task, observation: Observation, place: str) -> bool:
    sight = _sight(task, observation)
    if sight is None:
        return False
    half = task.cell.cube_size / 2.0 + 3e-3
    corners = np.array([[x, y, task.cell.cube_size] for x in (-half, half) for y in (-half, half)])
    return sight.shows(apply(T_base_on_table(task, place), corners))


@dataclass(frozen=True)
class Release:
    """A released cube that no look has confirmed yet.

    Attributes:
        row: of the cube in the report.
        source, target: names of the places.
        before: the last look with it at its source.
        T_base_tool: pose of the tool at its release.
        width: of the cube, if known.
        empty: the last look with an empty target; None: `before`.
        disturbed: the jaws closed on it before and did not hold it, so it may not have been seated at its source.
        held_back: the arm at rest before the jaws opened; None: not read.
    """

    row: CubeRow
    source: str
    target: str
    before: Observation
    T_base_tool: Array
    width: CubeWidth | None = None
    empty: Observation | None = None
    disturbed: bool = False
    held_back: HeldBack | None = None

    def judge(
        self, task: Task, after: Observation, again: bool = False
    ) -> tuple[Release, Unconfirmed | None]:
        """Judge it by a look.

        If contact held the arm back, one look that shows the cube seated does not confirm it, but another one does.

        Args:
            task: of the cube.
            after: the look.
            again: whether an earlier look has judged it already, or none would follow.

        Returns:
            The release with the measured width of the cube, and why it is not confirmed; None if it is.
        """
        width = self.width
        was_seated = not self.disturbed and not self.source.startswith(BESIDE)
        if was_seated and self.source not in self.before.moved_since:  # then its top tells its width
            width = width_at(task, self.before, self.source, after) or width
        why = confirm(task, self.before, after, self.source, self.target, width, self.empty)
        if self.held_back is not None and self.held_back.by_contact:
            if why is not None or not again:
                why = Unconfirmed((self.held_back.words(), *(() if why is None else why.reasons)), True)
            else:
                self.row.remarks.append(f"{self.held_back.words()}; but the look shows it seated")
        self.row.placed = why is None and self.target == self.row.target
        return replace(self, width=width), why
