"""How fast the tool is on paths for which a program states a speed: an upper limit, or one speed that is kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.plan_file import Move, Plan, Step
from arm.robot.model import Robot
from arm.se3 import Array
from cell.program.path_step import PathStep
from cell.program.program_file import ProgramTask
from cell.program.steps import name_of
from plan.program.goals.target import Target
from plan.program.planned import Planned

HEADER = ("path", "speed asked mm/s", "median mm/s", "at that speed, % of the length")
_SAMPLE_S = 0.005
_THERE = 0.95  # of a speed, from which on it counts as reached, and down to which it counts as kept
_LOWER = 0.98  # of the least speed seen, which is asked for next
_BETTER = (
    0.02  # least gain of the share of the speed that is kept, by which a lower speed is worth another plan
)


@dataclass(frozen=True)
class PathSpeed:
    """The tool's speed on one path.

    Attributes:
        move: name of the move.
        asked: m/s.
        median: over the length of the path, m/s.
        share: of its length on which the tool has at least 95 % of the speed.
    """

    move: str
    asked: float
    median: float
    share: float

    def row(self) -> tuple[str, ...]:
        """Its row of the table."""
        return self.move, f"{1e3 * self.asked:.0f}", f"{1e3 * self.median:.0f}", f"{100 * self.share:.0f}"

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        return {
            "move": self.move,
            "asked_mm_s": 1e3 * self.asked,
            "median_mm_s": round(1e3 * self.median, 1),
            "share_at_speed": round(self.share, 3),
        }


@dataclass(frozen=True)
class KeptSpeed:
    """One speed that the tool keeps on a path, within 5 %, from its run-up to its run-out.

    Attributes:
        move: name of the move.
        speed: that is kept, m/s.
        run_up, run_out: length at the start until the speed is reached, and from where it is left at the end, m.
    """

    move: str
    speed: float
    run_up: float
    run_out: float

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        return {
            "move": self.move,
            "kept_mm_s": round(1e3 * self.speed, 3),
            "run_up_mm": round(1e3 * self.run_up, 2),
            "run_out_mm": round(1e3 * self.run_out, 2),
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> KeptSpeed:
        """Return it from JSON types."""
        lengths = (1e-3 * float(value[key]) for key in ("kept_mm_s", "run_up_mm", "run_out_mm"))
        return cls(str(value["move"]), *lengths)

    def words(self) -> str:
        """Say it in one line."""
        return (
            f"{self.move}: the tool keeps {1e3 * self.speed:.1f} mm/s, from {1e3 * self.run_up:.1f} mm after the start "
            f"to {1e3 * self.run_out:.1f} mm before the end"
        )


def path_speeds(task: ProgramTask, plan: Plan) -> list[PathSpeed]:
    """Return the speeds on all paths of a plan for which its program states one."""
    asked = {
        f"{way} {name}": s.speed for name, s in _paths(task) for way in ("along", "back along") if s.speed
    }
    robot, unit = task.cell.robot_holding(), task.cell.unit
    found = []
    for move in plan.moves:
        speed = asked.get(_whole(move.name))
        if speed is not None:
            found.append(_on(move, speed, _steps(move, robot, unit)))
    return found


def _paths(task: ProgramTask) -> Iterator[tuple[str, PathStep]]:
    """Yield the paths of all repeats, with their names in plans."""
    for repeat in range(task.repeat):
        yield from ((name_of(step, repeat), step) for step in task.steps if isinstance(step, PathStep))


def _whole(name: str) -> str:
    """Name of the path of a move or goal that may be one of its legs."""
    return name.split(", leg ")[0]


def _steps(move: Move, robot: Robot, unit: Unit) -> Array:
    """Return the lengths (k,) m that the tool makes on a move in each `_SAMPLE_S`."""
    at: Array = np.array([robot.T_base_tool(q)[:3, 3] for q in unit.positions(move.path.sample(_SAMPLE_S))])
    return np.asarray(np.sqrt((np.diff(at, axis=0) ** 2).sum(axis=1)))


def _on(move: Move, asked: float, steps: Array) -> PathSpeed:
    order = np.argsort(steps, kind="stable")
    half = np.searchsorted(np.cumsum(steps[order]), 0.5 * steps.sum())
    median = steps[order[min(int(half), len(steps) - 1)]] / _SAMPLE_S
    there = steps[steps >= _THERE * asked * _SAMPLE_S].sum() / max(float(steps.sum()), 1e-12)
    return PathSpeed(move.name, asked, float(median), float(there))


def with_kept_speeds(
    task: ProgramTask, goals: Sequence[Target], planned: Callable[[Sequence[Target]], Planned]
) -> tuple[Planned, tuple[KeptSpeed, ...]]:
    """Plan a program so that the tool keeps one speed on each path that asks for it, at most the one that is stated.

    A plan is made with the speeds that are stated. Where the tool is slower between run-up and run-out, the path gets
    the least speed seen there as its limit, and all is planned again.

    Args:
        task: the program.
        goals: of the program.
        planned: plans goals.

    Raises:
        ImpossibleError: see `planned`; or a path on which the tool slows down at any speed.
    """
    kept = {name: step.speed for name, step in _paths(task) if step.steady and step.speed is not None}
    shares, robot, unit = dict.fromkeys(kept, 0.0), task.cell.robot_holding(), task.cell.unit
    while True:
        found = planned([replace(goal, speed=kept.get(_whole(goal.name), goal.speed)) for goal in goals])
        seen = _kept(found.steps, kept, robot, unit)
        slower = {name: least for name, (least, _) in seen.items() if least < _THERE * kept[name]}
        if not slower:
            return found, tuple(one for _, of_path in seen.values() for one in of_path)
        for name, least in slower.items():
            share = least / kept[name]
            if share < shares[name] + _BETTER:
                raise ImpossibleError(
                    f"path {name!r}: the tool keeps no speed: at {1e3 * kept[name]:.1f} mm/s it slows down to "
                    f"{1e3 * least:.1f} mm/s, and hardly less if it is slower; round its corners more, free more "
                    "directions, or leave out steady",
                    target=name,
                    speed_m_s=kept[name],
                    least_m_s=least,
                )
            shares[name], kept[name] = share, _LOWER * least


def _kept(
    steps: Sequence[Step], kept: Mapping[str, float], robot: Robot, unit: Unit
) -> dict[str, tuple[float, list[KeptSpeed]]]:
    """Return for each path the least speed between run-up and run-out on its moves, m/s, and what each move keeps."""
    found: dict[str, tuple[float, list[KeptSpeed]]] = {}
    for move in steps:
        if not isinstance(move, Move):
            continue
        name = _whole(move.name).removeprefix("back ").removeprefix("along ")
        if move.role != "line" or name not in kept:
            continue
        lengths = _steps(move, robot, unit)
        there = np.flatnonzero(lengths >= _THERE * kept[name] * _SAMPLE_S)
        if not len(there):
            found[name] = float(lengths.max() / _SAMPLE_S), []
            continue
        first, last = int(there[0]), int(there[-1])
        least = float(lengths[first : last + 1].min() / _SAMPLE_S)
        speed = KeptSpeed(
            move.name, kept[name], float(lengths[:first].sum()), float(lengths[last + 1 :].sum())
        )
        before, others = found.get(name, (np.inf, []))
        found[name] = min(before, least), [*others, speed]
    return found
