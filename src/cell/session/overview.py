"""Summary of a plan: ranges and speeds of joints and tool, and the smallest clearance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Unit
from arm.plan_file import Plan
from arm.robot.model import Robot
from arm.se3 import Array

SAMPLE_S = 0.02  # sampling interval for ranges and speeds


@dataclass(frozen=True, eq=False)
class Overview:
    """Summary of a plan's motion.

    Attributes:
        lowest, highest: range of each joint, (n,) rad.
        travel: total distance of each joint, (n,) rad.
        fastest: maximum speed of each joint, (n,) rad/s at the plan's speed.
        tool: maximum speed of the tool, m/s.
        clearance: smallest of all moves, m.
        closest: the two bodies with this clearance.
    """

    lowest: Array
    highest: Array
    travel: Array
    fastest: Array
    tool: float
    clearance: float
    closest: tuple[str, str]


def overview(plan: Plan, robot: Robot, unit: Unit) -> Overview:
    """Summarise a plan with at least one move, for its robot and the unit of its counts."""
    paths = [unit.positions(move.path.sample(SAMPLE_S)) for move in plan.moves]
    steps = [np.diff(path, axis=0) for path in paths]
    at = [np.array([robot.T_base_tool(q)[:3, 3] for q in path]) for path in paths]
    joined, moved = np.concatenate(paths), np.abs(np.concatenate(steps))
    nearest = min(plan.moves, key=lambda move: move.clearance)
    return Overview(
        joined.min(axis=0),
        joined.max(axis=0),
        moved.sum(axis=0),
        moved.max(axis=0) / SAMPLE_S,
        max(float(np.linalg.norm(np.diff(p, axis=0), axis=1).max(initial=0.0)) for p in at) / SAMPLE_S,
        nearest.clearance,
        nearest.closest,
    )
