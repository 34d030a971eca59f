"""How fast the tool is on paths for which a program states a speed, which is only an upper limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from arm.plan_file import Move, Plan
from arm.se3 import Array
from cell.program.planning import program_goals
from cell.program.program_file import ProgramTask

HEADER = ("path", "speed asked mm/s", "median mm/s", "at that speed, % of the length")
_SAMPLE_S = 0.005
_THERE = 0.95  # of the speed, from which on it counts as reached


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


def path_speeds(task: ProgramTask, plan: Plan) -> list[PathSpeed]:
    """Return the speeds on all paths of a plan for which its program states one."""
    asked = {
        f"{way} {goal.name}": goal.speed
        for goal in program_goals(task, np.eye(4))
        for way in ("along", "back along")
        if goal.by == "path" and goal.speed is not None
    }
    return [_on(move, asked[move.name], task) for move in plan.moves if move.name in asked]


def _on(move: Move, asked: float, task: ProgramTask) -> PathSpeed:
    q = task.cell.unit.positions(move.path.sample(_SAMPLE_S))
    robot = task.cell.robot_holding()
    at: Array = np.array([robot.T_base_tool(one)[:3, 3] for one in q])
    steps = np.sqrt((np.diff(at, axis=0) ** 2).sum(axis=1))
    order = np.argsort(steps, kind="stable")
    half = np.searchsorted(np.cumsum(steps[order]), 0.5 * steps.sum())
    median = steps[order[min(int(half), len(steps) - 1)]] / _SAMPLE_S
    there = steps[steps >= _THERE * asked * _SAMPLE_S].sum() / max(float(steps.sum()), 1e-12)
    return PathSpeed(move.name, asked, float(median), float(there))
