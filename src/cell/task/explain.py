"""Explain a refusal to plan at the terminal: the rejected candidates, and advice that was tried by planning."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from arm.board import plate_name
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.robot.shapes import Box
from arm.se3 import apply, inverse
from cell.config.cell import Cell
from cell.config.doubts.cell_doubts import enclosing
from cell.console import Console
from cell.files.task import Task
from cell.scene.places import hole_stations, reach_of
from cell.task.planning import Rest, empty_request, request_of
from plan.advice.changes import Request
from plan.advice.search import Advice, advise
from plan.failure import START_BLOCKED, Failure, Rejected, failure_in
from plan.program.assignment.cause import out_of_reach
from vision.observation import Observation

_ROWS_A_PLACE, _ROWS = 3, 12  # of the table of candidates: per place, and in all


@contextmanager
def explain_failure(rest: Rest, wanted: bool, every_hole: bool = False) -> Iterator[None]:
    """Explain a refusal to plan on standard error, with advice; re-raise it with `failure` and `advice` as data.

    Args:
        rest: what is planned.
        wanted: whether to give advice.
        every_hole: whether all holes of the task's boards must be in reach, used or not.
    """
    task, observation = rest.task, rest.observation
    try:
        yield
    except ImpossibleError as error:
        if "advice" not in error.data:
            if "failure" not in error.data and "holes" in error.data:
                error.data["failure"] = out_of_reach(error, reach_of(task, observation, rest.speed)).to_json()
            failure = failure_in(error)
            if failure is not None:
                console = Console(as_json=True)  # standard error
                print_failure(console, failure)
                try:
                    request = request_of(rest)
                except ImpossibleError:  # more cubes than reachable places: then only reach is checked
                    request = empty_request(rest)
                if every_hole:
                    request = replace(request, required=hole_stations(task, observation))
                advice = _advice(console, task, observation, request, error) if wanted else ()
                error.data["advice"] = [a.to_json() for a in advice]
                if failure.kind == START_BLOCKED:
                    why = f"{error}; {_conflict(task.cell, failure)}"
                    raise ImpossibleError(why, **error.data) from error
        raise


def explain_list_failure(
    task: Task, observation: Observation | None, request: Request, error: ImpossibleError
) -> None:
    """Explain a refusal to plan a list on standard error, with advice; add `advice` to the error's data."""
    failure = failure_in(error)
    if failure is not None:
        console = Console(as_json=True)  # standard error
        print_failure(console, failure)
        error.data["advice"] = [a.to_json() for a in _advice(console, task, observation, request, error)]


def _conflict(cell: Cell, failure: Failure) -> str:
    """The values of the cell file that contradict each other if the start is blocked."""
    start = f"q_start_deg = [{', '.join(f'{v:g}' for v in np.round(np.degrees(cell.q_start), 3))}]"
    other = f"the place of {failure.body}" if failure.body else "the obstacle"
    near = failure.ways[0]
    if failure.body is None and near.pair is not None and near.distance_mm is not None:
        both = f"both are parts of the arm: in {cell.file.name},"
        if near.distance_mm < 1e3 * cell.least_clearance:  # which no clearance may be below
            return f"{both} {start} has to change"
        lower = math.floor(10.0 * near.distance_mm) / 10.0
        return f"{both} lower motion.clearance_mm to {lower:g} or less, or change {start}"
    if failure.body is not None and (around := enclosing(cell).get(failure.body)):
        return f"in {cell.file.name}, {around}"
    if failure.body == "table":
        other = f"table.top_z_mm = {cell.table_z * 1e3:g}"
    return f"in {cell.file.name}, {start} or {other} has to change"


def print_failure(console: Console, failure: Failure) -> None:
    """Print why candidates were rejected, the nearest miss of each place first; equal reasons share a row."""
    alike: dict[tuple[str, str], list[Rejected]] = {}
    for rejected in failure.ways:
        alike.setdefault((rejected.where, rejected.reason), []).append(rejected)
    rows, places = [], Counter[str]()
    for (where, reason), group in alike.items():
        places[where] += 1
        if places[where] <= _ROWS_A_PLACE or len({w.where for w in failure.ways}) == 1:
            yaw = "" if group[0].yaw is None else f"yaw {group[0].yaw}, {group[0].branch}"
            rows.append((where, len(group), yaw, reason))
    console.say(f"{failure.kind}: {failure.step}")
    columns = [0, 1, 2, 3] if any(row[2] for row in rows) else [0, 3]
    header = ("where", "candidates", "for example", "rejected because")
    if [row[3] for row in rows] != [failure.headline]:  # the refusal itself follows
        console.table([header[i] for i in columns], [[row[i] for i in columns] for row in rows[:_ROWS]])
    more = len(failure.ways) - sum(row[1] for row in rows[:_ROWS])
    if more:
        console.say(f"and {more} more candidates; --json lists all")


def _advice(
    console: Console, task: Task, observation: Observation | None, request: Request, error: ImpossibleError
) -> tuple[Advice, ...]:
    console.say("what would help (each suggestion was planned; --no-advice skips this):")
    advice = advise(
        request,
        error,
        fits=lambda changed: observation is None or _may_stand(task, observation, request, changed),
        tell=lambda text: console.step(f"try: {text}"),
    )
    for piece in advice:
        console.say(f"- {piece.text}")
    if not advice:
        tried = "moving or removing single bodies" if request.goals else "moving single boards or bodies"
        console.say(f"- nothing found by {tried}{'' if request.goals else ', or leaving out single cubes'}")
    return advice


def _may_stand(task: Task, observation: Observation, request: Request, changed: Request) -> bool:
    """Whether all boards are in the cell file's zone, and every moved board's markers are in the image."""
    zone, camera = task.cell.zone, task.cell.camera
    half = np.array(zone.shape.size[:2]) / 2.0 if isinstance(zone.shape, Box) else np.full(2, np.inf)
    before = {b.name: b.T_base_body for b in request.scene.bodies}
    for plate in (b for b in changed.scene.bodies if b.kind == "board"):
        if (np.abs((plate.T_base_body[:3, 3] - zone.T_base_body[:3, 3])[:2]) > half).any():
            return False
        board = observation.board(plate.name.removeprefix(plate_name("")))
        if board is None or np.array_equal(plate.T_base_body, before[plate.name]):
            continue
        T_base_board = mul(mul(plate.T_base_body, inverse(before[plate.name])), board.pose.T_base_board)
        pixels = camera.project_base(apply(T_base_board, board.pose.board.marker_corners()))
        if not ((pixels >= 0.0) & (pixels <= np.array(camera.size) - 1.0)).all():  # NaN behind the camera
            return False
    return True
