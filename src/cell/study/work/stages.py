"""What becomes of a point of a study: each stage is asked as its own command would be; the first refusal ends it."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from tempfile import gettempdir
from typing import Any
from weakref import finalize

import numpy as np

from arm.errors import A465Error, ExecutionStopped, ImpossibleError, InputError
from arm.io.temporary import TemporaryFolder
from arm.plan_file import Plan
from arm.poses import BoardPose
from cell.accuracy.clearances import erring_clearances
from cell.accuracy.error_model import ErrorModel
from cell.accuracy.measures import least_insertion, require_insertion
from cell.accuracy.plan_budgets import require_placements
from cell.commands.run import run_task
from cell.console import Console
from cell.files.observation import require_boards
from cell.files.study import Study
from cell.files.task import Task
from cell.files.world import World
from cell.scene.places import nothing_to_plan, reach_of
from cell.session.camera_watch import camera_watch, look_in
from cell.session.connection import WhichCell, camera_at_start
from cell.session.speed import planning_speed
from cell.study.question.points import points_of
from cell.study.question.scratch import Bundle, Scratch
from cell.study.work.outcome import Outcome
from cell.study.work.quick_reach import QuickReach
from cell.task.look import foreseen
from cell.task.planning import Rest, plan_rest, require_above_table
from plan.failure import failure_in
from vision.boards.checks import Spread
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import Occupancy

_OF_DATA = {
    "below_mm": "below the table",
    "insertion": "error budget",
    "places": "too few free holes",
    "moved_mm": "camera moved",
    "height": "board {board} not as high and flat as the task says",
    "board": "view: board {board}",
    "hole": "view: a hole is unsure",
}
"""What an error with such data says; the first that it has."""
_HOLE = re.compile(r"\b(\d+-\d+)/\d+")


class Evaluator:
    """Computes points of a study; makes its files in a folder of its own.

    Args:
        bundle: the study's files.
    """

    def __init__(self, bundle: Bundle) -> None:
        # the next study removes the folder of one that was killed
        try:
            folder = TemporaryFolder(Path(gettempdir()) / "study")
        except OSError as error:
            why = f"{gettempdir()}: a folder cannot be made there: {error.strerror}"
            raise InputError(why, file=gettempdir()) from error
        finalize(self, folder.__exit__)
        self._scratch = Scratch(bundle, folder.path)
        self._folder = folder.path
        self._quick = QuickReach.of(self.study, self._scratch.task, self._scratch.world)

    @property
    def study(self) -> Study:
        """The study."""
        return self._scratch.study

    def table(self, first: int, count: int) -> str:
        """Return the rows of some points as CSV: number, values, and `RESULTS`."""
        points = points_of(self.study, first, count)
        if self._quick is None:
            outcomes = [self._outcome(values, None) for values in points]
        else:
            reached = self._quick.outcomes(points)
            more = len(self.study.stages) > 1
            outcomes = [
                self._outcome(values, seen) if more and seen.ok else seen
                for values, seen in zip(points, reached, strict=True)
            ]
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        for number, (values, outcome) in enumerate(zip(points, outcomes, strict=True), first):
            rows.writerow([number, *values, *outcome.row()])
        return text.getvalue()

    def _outcome(self, values: Sequence[Any], reached: Outcome | None) -> Outcome:
        """What becomes of a point; `reached`: where the stage reach has passed already."""
        outcome = reached or Outcome(self.study.stages[0])
        try:
            self._scratch.set(values)
        except InputError as error:
            _require_of_point(error)
            outcome.refuse("wrong value", str(error))
            return outcome
        task, world, seen = self._scratch.task, self._scratch.world, None
        try:
            for stage in self.study.stages:
                if stage == "reach" and reached is not None:
                    continue
                outcome.stage = stage
                if stage == "reach":
                    outcome.margin_deg = require_reach(task, exact_look(task, world))
                elif stage == "look":
                    seen = look_at(task, world)
                    outcome.hole_std_mm = least_certain_mm(task, seen)
                    outcome.insertion = require_foreseen(task, seen)
                elif stage == "plan":
                    require_plan(task, seen or exact_look(task, world), outcome)
                else:
                    self._run(task, world)
        except A465Error as error:
            _require_of_point(error)
            outcome.refuse(reason_of(error), self._scratch.named(str(error)))
        return outcome

    def _run(self, task: Task, world: World) -> None:
        with TemporaryFolder(self._folder / "run") as folder, redirect_stderr(io.StringIO()):
            with redirect_stdout(io.StringIO()):
                console = Console()
            run_task(task.file, console, WhichCell(world=world.file), folder.path / "run")


def _require_of_point(error: A465Error) -> None:
    """Raise what says nothing about a point: somebody interrupted it, or a file could not be read or written."""
    if error.data.get("reason") == "interrupted":
        raise KeyboardInterrupt from error
    if isinstance(error, InputError) and isinstance(error.__cause__, OSError):
        raise error


def exact_look(task: Task, world: World) -> Observation:
    """Return a look without noise at a world: true poses, with a standard deviation of 0.1 mm and 0.1 mrad."""
    boards = []
    for true in world.boards:
        pose = BoardPose(true.board, true.T_base_board, 1e-8 * np.eye(6), 0.1, 100.0)
        holes = range(len(true.board.holes))
        states = (Occupancy("cube" if hole in true.cubes else "empty") for hole in holes)
        boards.append(ObservedBoard(pose, tuple(states)))
    return Observation(tuple(boards))


def look_at(task: Task, world: World) -> Observation:
    """Look at a world as `a465 look` does, with the arm at q_start.

    Raises:
        ImpossibleError: a board of the task was not found.
    """
    images = camera_at_start(task, world.file).grab(task.cell.photographs)
    seen = look_in(task.cell, images, False, camera_watch(task.cell))
    require_boards(seen, task)
    return seen


def least_certain_mm(task: Task, seen: Observation) -> float:
    """Return the standard deviation of the position of the least certain hole of a task's boards, in its plate, mm."""
    names = {board.name for board in task.boards}
    poses = [one.pose for one in seen.boards if one.pose.board.name in names]
    return 1e3 * max(Spread.of(pose).sideways for pose in poses)


def require_foreseen(task: Task, seen: Observation) -> float | None:
    """Require that each placement is likely enough, as `a465 look` does; None: the cell's errors are not known.

    Raises:
        ImpossibleError: a cube is too likely to miss its pocket.
    """
    if not ErrorModel.available(task.cell):
        return None
    return least_insertion(require_insertion(task.cell, seen, foreseen(task, seen)))


def require_reach(task: Task, seen: Observation) -> float:
    """Require that every hole is in reach, as `a465 reach` does; return the least margin of a joint, deg.

    Raises:
        ImpossibleError: a hole is out of reach, or below the table.
    """
    require_boards(seen, task)
    require_above_table(task, seen)
    table = reach_of(task, seen)
    table.require()
    return float(np.degrees(min(hole.best.margin for hole in table.holes)))


def require_plan(task: Task, seen: Observation, outcome: Outcome) -> Plan:
    """Plan as `a465 plan --no-advice` does; enter what the plan is like.

    Raises:
        ImpossibleError: there is no plan, or a cube is too likely to miss its pocket.
    """
    cell = task.cell
    require_boards(seen, task)
    plan = plan_rest(Rest(task, seen, cell.q_start, planning_speed(cell, None)))
    if plan is None:
        raise nothing_to_plan(task, seen)
    budgets = require_placements(cell, seen, plan)
    erring = erring_clearances(cell, plan, seen)
    outcome.clearance_mm = 1e3 * min(erring or [move.clearance for move in plan.moves])
    outcome.motion_s = plan.duration_s
    if budgets:
        outcome.insertion = least_insertion(budgets)
    return plan


def reason_of(error: A465Error) -> str:
    """Return why a stage refused, in few words that many points share."""
    data = error.data
    if "holes" in data:
        miss = data["holes"][0]
        if "outside_mm" in miss:
            return "beyond the arm's reach"
        if "racing" in miss:
            return f"joint {miss['racing']} too fast"
        return f"joint {miss['joint']} beyond its limit" if "joint" in miss else "out of reach"
    if isinstance(error, ImpossibleError) and (failure := failure_in(error)) is not None:
        way = next((way for way in failure.ways if way.pair or way.joint), None)
        if way is None:
            return failure.kind
        if way.pair:
            return f"{failure.kind}: {_bodies(way.pair)}"
        return f"joint {way.joint} {'too fast' if way.excess_deg is None else 'beyond its limit'}"
    if "pair" in data:
        with_errors = " with the arm's errors" if "required_mm" in data else ""
        return f"clearance{with_errors}: {_bodies(data['pair'])}"
    for name, why in _OF_DATA.items():
        if name in data:
            return why.format(**data)
    if "cubes" in data and (missed := [cube for cube in data["cubes"] if not cube["placed"]]):
        return f"cube {missed[0]['faults'][0] if missed[0]['faults'] else 'not seated'}"
    kind = {ExecutionStopped: "stopped", InputError: "wrong value"}.get(type(error), "refused")
    return f"{kind}: {data['reason']}" if isinstance(data.get("reason"), str) else kind


def _bodies(pair: Sequence[str]) -> str:
    """Name two bodies; cubes of one board are the same."""
    return " and ".join(sorted(_HOLE.sub(r"\1", name) for name in pair))
