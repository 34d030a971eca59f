"""Holes and places that a task uses, as stations, and the arm's reach of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Set

import numpy as np

from arm.errors import ImpossibleError
from cell.files.task import HOLES, Task
from cell.scene.build import RELEASE_GAP, covering_boards, free_table_stations, hole_station
from cell.scene.options import options_of
from plan.cartesian.reachability import ReachTable, reach_stations
from plan.program.setting import planned_limits
from plan.scene import Station
from vision.observation import Observation


def hole_stations(task: Task, observation: Observation) -> tuple[Station, ...]:
    """Holes that the task uses as stations; at the target, cubes are released slightly above the hole."""
    gaps = {b.name: 0.0 if b is task.from_board else RELEASE_GAP for b in task.boards}
    unused = unused_holes(task)
    return tuple(
        hole_station(task.cell, hole, gaps[board.name])
        for board in observation.boards
        if board.name in gaps
        for hole in board.pose.holes
        if hole.name not in unused
    )


def unused_holes(task: Task) -> Set[str]:
    """Holes of the target board that no cube may be put into."""
    left_out = set(HOLES) - set(task.to_holes)
    return set() if task.to_board is None else {f"{task.to_board.name}/{number}" for number in left_out}


def reach_of(task: Task, observation: Observation, speed: float | None = None) -> ReachTable:
    """The planner's table of reach for all holes of the task's boards, over all branches and the cube's four yaws.

    Args:
        task, observation: with the boards.
        speed: for which to plan, which matters near singular configurations; default: the cell's.
    """
    return _reach(task, hole_stations(task, observation), speed)


def _reach(task: Task, stations: Iterable[Station], speed: float | None) -> ReachTable:
    cell = task.cell
    options = options_of(task, cell.speed if speed is None else speed)
    return reach_stations(cell.robot(), planned_limits(cell.limits, options, cell.unit), stations, options)


def reachable_places(task: Task, observation: Observation, speed: float | None = None) -> tuple[Station, ...]:
    """The places on the table that no board covers and the arm can reach, in order of preference."""
    stations = free_table_stations(task, observation.poses)
    if not stations:
        return ()
    table = _reach(task, stations, speed)
    return tuple(s for s in stations if table[s.name].ok)


def taken_places(
    task: Task, observation: Observation, filled: Set[str], speed: float | None = None
) -> tuple[str, str]:
    """Say how many of the places on the table are taken by what or out of reach, and which key would help.

    Args:
        task, observation: of them.
        filled: places that hold a cube.
        speed: as for `reach_of`.
    """
    covered = {f"table/{n}": b for n, b in enumerate(covering_boards(task, observation.poses), start=1)}
    reached = {s.name for s in reachable_places(task, observation, speed)}
    boards = Counter(board for name, board in covered.items() if board is not None and name not in filled)
    held = sum(name in filled for name in covered)
    out = sum(board is None and name not in reached | filled for name, board in covered.items())
    counts = [f"{n} under or too near to board {board}" for board, n in boards.items()]
    counts += [f"{n} {what}" for n, what in ((held, "with a cube"), (out, "out of reach")) if n]
    away = [f"away from board {board}" for board in boards] + ["into reach"] * bool(out)
    cure = f"places.origin_mm in {task.file.name} moves them"
    more = "places.count gives more"
    return (
        f" of {len(covered)}: {', '.join(counts)}",
        f"{cure} {' and '.join(away)}, {more}" if away else more,
    )


def out_of_view(task: Task) -> str:
    """Say that fewer places on the table than a board has holes are in the camera's view, which shall look at the cubes
    there; "" if enough are, or nobody looks."""
    if task.places is None or task.look_after == "never":
        return ""
    cell = task.cell
    centres = np.array([(x, y, cell.table_z + cell.cube_size) for x, y in task.places.centres])
    pixels = cell.camera.project_base(centres)
    inside = int(((pixels >= 0.0) & (pixels <= np.array(cell.camera.size) - 1.0)).all(axis=1).sum())
    if inside >= len(HOLES):
        return ""
    return (
        f"{task.file.name}: places.origin_mm: {inside} of {len(centres)} places are in the camera's view, so looks "
        "cannot confirm the cubes at the others: is it x, then y, and are their signs right?"
    )


def nothing_to_plan(task: Task, observation: Observation) -> ImpossibleError:
    """The error for a source board without cubes; it says so if the target board has some."""
    board, target = task.from_board, task.to_board
    seen = None if target is None else observation.board(target.name)
    there = 0 if seen is None else len(seen.holes("cube"))
    hint = ""
    if target is not None and there:
        hint = (
            f" (from_board = {list(board.marker_ids)}; board {target.name}, the to_board, holds {there}: is the task "
            f"done, or are they swapped in {task.file.name}?)"
        )
    return ImpossibleError(
        f"board {board.name} holds no cube: there is nothing to plan{hint}", board=board.name
    )
