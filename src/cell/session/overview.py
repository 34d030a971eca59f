"""What a plan moves, at a glance: ranges and speeds of joints and tool, and what comes nearest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Unit
from arm.plan_file import Plan
from arm.robot.model import Robot
from arm.se3 import Array

SAMPLE_S = 0.02  # of the plan, for ranges and speeds


@dataclass(frozen=True, eq=False)
class Overview:
    """What a plan moves.

    Attributes:
        lowest, highest: of each joint, (n,) rad.
        travel: of each joint, all ways summed, (n,) rad.
        fastest: of each joint, (n,) rad/s at the plan's speed.
        tool: fastest speed of the tool, m/s.
        clearance: least of all moves, m.
        closest: the two bodies that come so near.
    """

    lowest: Array
    highest: Array
    travel: Array
    fastest: Array
    tool: float
    clearance: float
    closest: tuple[str, str]


def overview(plan: Plan, robot: Robot, unit: Unit) -> Overview:
    """Ranges and speeds of all that a plan sends.

    Args:
        plan: with one move at least.
        robot: that it moves.
        unit: whose counts it is in.
    """
    ways = [unit.positions(move.path.sample(SAMPLE_S)) for move in plan.moves]
    steps = [np.diff(way, axis=0) for way in ways]
    at = [np.array([robot.T_base_tool(q)[:3, 3] for q in way]) for way in ways]
    joined, moved = np.concatenate(ways), np.abs(np.concatenate(steps))
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
