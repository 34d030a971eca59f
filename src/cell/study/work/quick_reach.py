"""Reach of many placements of boards at once, where nothing but their poses varies."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np

from arm.io.rules import is_number
from arm.io.toml_reader import read_toml
from arm.poses import BoardPose
from arm.se3 import Array
from cell.files.study import BOARD_POSE, Study
from cell.files.task import Task
from cell.files.world import World, board_placement
from cell.scene.options import options_of
from cell.scene.places import hole_stations
from cell.study.work.outcome import Outcome
from plan.cartesian.line_margins import heights_of, line_margins
from plan.kinematics.closed_form import has_closed_form
from plan.program.setting import planned_limits
from vision.observation import Observation, ObservedBoard

_AT_A_TIME = 128  # lines whose arrays fit into the processor's cache
_LARGEST = {"centre_mm": 2000.0, "yaw_deg": 360.0, "tilt_deg": 60.0, "lean_azimuth_deg": 360.0}


class _Best(NamedTuple):
    """The best grasp of a hole; see `plan.cartesian.line_margins.LineMargins`."""

    ok: bool
    outside: float
    margin: float
    joint: int
    racing: int

    def why(self, names: Sequence[str]) -> tuple[str, str]:
        """Return why it does not serve, in few words and in more."""
        if self.outside > 0.0:
            return "beyond the arm's reach", f"{1e3 * self.outside:.1f} mm beyond"
        if self.margin < 0.0:
            return f"joint {names[self.joint]} beyond its limit", f"by {np.degrees(-self.margin):.1f} deg"
        return f"joint {names[self.racing]} too fast", "near a singular configuration"


class QuickReach:
    """Reach of all holes of a task, for boards that stand elsewhere.

    It tells what `cell.study.work.stages.require_reach` tells, in a fraction of the time: it reads no files, tries
    the lines of many placements at once, and tries the next hole only where those before are in reach.
    """

    def __init__(self, study: Study, task: Task, world: World) -> None:
        cell, options = task.cell, options_of(task, task.cell.speed)
        self._robot = cell.robot()
        self._limits = planned_limits(cell.limits, options, cell.unit)
        self._heights, self._slowest = heights_of(options.offset), options.slowest
        self._table_z = cell.table_z
        self._plates = [true.board.plate for true in world.boards]
        self._stated = read_toml(world.file)["boards"]
        self._fixed = [true.T_base_board for true in world.boards]
        self._keys = [_split(one.key) for one in study.vary]
        at = {true.board.name: index for index, true in enumerate(world.boards)}
        unmoved = [
            ObservedBoard(BoardPose(true.board, np.eye(4), np.eye(6), 0.1, 100.0), ())
            for true in world.boards
        ]
        # stations of boards at the origin: the constant part of each grasp
        stations = hole_stations(task, Observation(tuple(unmoved)))
        self._names = [station.name for station in stations]
        self._board = np.array([at[name.rpartition("/")[0]] for name in self._names])  # of each hole
        self._grasps = np.stack(
            [np.stack(station.T_base_tool) for station in stations]
        )  # (holes, yaws, 4, 4)
        moving = np.isin(self._board, [index for index, _, _ in self._keys])
        still = np.flatnonzero(~moving)
        self._still = {hole: self._best(np.stack(self._fixed)[None], hole)[0] for hole in map(int, still)}
        used = {board.name for board in task.boards}
        self._holes = [
            (index, true.board.T_board_hole(hole))
            for index, true in enumerate(world.boards)
            if true.board.name in used
            for hole in range(len(true.board.holes))
        ]

    @classmethod
    def of(cls, study: Study, task: Task, world: World) -> QuickReach | None:
        """Return it if it can tell what the study asks first, else None."""
        poses = all(
            one.file == "world" and _within(one.key, one.grid or (one.low, one.high)) for one in study.vary
        )
        seen = {true.board.name for true in world.boards}
        whole = all(board.name in seen for board in task.boards)
        if study.stages[0] != "reach" or not poses or not whole or task.board_height is not None:
            return None
        return cls(study, task, world) if has_closed_form(task.cell.robot()) else None

    def outcomes(self, points: Sequence[Sequence[Any]]) -> list[Outcome]:
        """Return the outcome of the stage reach at each of some points."""
        boards = np.stack([self._boards(values) for values in points])  # (points, boards, 4, 4)
        found = [self._above_table(T_boards) for T_boards in boards]
        margins = np.full(len(points), np.inf)
        for hole, name in enumerate(self._names):
            left = np.flatnonzero([outcome.ok for outcome in found])
            still = self._still.get(hole)
            best = [still] * len(left) if still else self._best(boards[left], hole)
            for k, one in zip(left.tolist(), best, strict=True):
                margins[k] = min(margins[k], one.margin)
                if not one.ok:
                    why, more = one.why(self._robot.joint_names)
                    found[k].refuse(why, f"hole {name}: {more}")
        for outcome, margin in zip(found, margins.tolist(), strict=True):
            if outcome.ok:
                outcome.margin_deg = float(np.degrees(margin))
        return found

    def _above_table(self, T_boards: Array) -> Outcome:
        outcome = Outcome("reach")
        lowest = min(float(T_boards[index, 2] @ T_board_hole[:, 3]) for index, T_board_hole in self._holes)
        if lowest < self._table_z:
            depth = 1e3 * (self._table_z - lowest)
            outcome.refuse("below the table", f"a hole is {depth:.1f} mm below the table's top")
        return outcome

    def _best(self, boards: Array, hole: int) -> list[_Best]:
        """The best grasp of a hole, boards (points, boards, 4, 4), as `plan.cartesian.reachability` ranks it."""
        ends = boards[:, self._board[hole], None] @ self._grasps[hole]  # (points, yaws, 4, 4)
        found: list[_Best] = []
        step = max(1, _AT_A_TIME // ends.shape[1])
        for some in (ends[first : first + step] for first in range(0, len(ends), step)):
            lines = line_margins(
                self._robot, self._limits, some.reshape(-1, 4, 4), self._heights, self._slowest, exact=False
            )
            values = [  # all yaws and branches of each point
                one.reshape(len(some), -1)
                for one in (lines.ok, lines.outside, lines.margin, lines.joint, lines.racing)
            ]
            first = np.lexsort((-values[2], values[1], np.logical_not(values[0])), axis=-1)[:, :1]
            rows = (np.take_along_axis(one, first, axis=-1)[:, 0].tolist() for one in values)
            found += [_Best(*row) for row in zip(*rows, strict=True)]
        return found

    def _boards(self, values: Sequence[Any]) -> Array:
        """Where the boards stand at a point, (boards, 4, 4)."""
        moved = set()
        stated = deepcopy(self._stated)
        for (index, name, item), value in zip(self._keys, values, strict=True):
            moved.add(index)
            if item is None:
                stated[index][name] = value
            else:
                stated[index][name][item] = value
        T = np.stack(self._fixed)
        for index in moved:
            of = stated[index]
            yaw, tilt, lean = np.radians([of["yaw_deg"], of["tilt_deg"], of.get("lean_azimuth_deg", 0.0)])
            centre = 1e-3 * np.array(of["centre_mm"], dtype=float)
            T[index] = board_placement(centre, yaw, tilt, lean, self._plates[index])
        return T


def _split(key: str) -> tuple[int, str, int | None]:
    found = BOARD_POSE.fullmatch(key)
    if found is None:
        raise ValueError(key)
    return int(found[1]), found[2] or found[4], None if found[3] is None else int(found[3])


def _within(key: str, values: Sequence[Any]) -> bool:
    """Whether a key is of a board's pose, and its values are ones that a world file may have."""
    found = BOARD_POSE.fullmatch(key)
    if found is None or not all(is_number(value) for value in values):
        return False
    name = found[2] or found[4]
    least = 0.0 if name == "tilt_deg" else -_LARGEST[name]
    return all(least <= value <= _LARGEST[name] for value in values)
