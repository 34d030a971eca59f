"""Lower bounds on motion time with nothing in the way.

LB: rest at home, at every offset point and at every station; straight synchronised trapezoids between, lines timed
under joint limits alone; the best over all yaws and branches. Motion that does not stop at offset points can beat it.

LB0: what no motion can beat that goes through the offset points, along the lines, and rests where the gripper acts.
Between two rests, each joint goes through known values in order. The time is at least (1) the sum over steps between
those of the slowest joint's at full speed, and (2) for each joint, the time of its own fastest motion through them: it
stops wherever its direction turns, because a turn beyond a forced value only makes both ways longer.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array
from arm.unit import Limits
from plan.line import JointPath
from plan.timing import time_line
from plan.travel import straight_time
from planning_bench.grips import GripLine, grip_lines
from planning_bench.query import OFFSET, Query


@dataclass(frozen=True)
class Bounds:
    """Of one query, s."""

    LB: float
    LB0: float


def bounds(query: Query) -> Bounds:
    """Both bounds, best over yaws and branches along the whole chain of transfers."""
    robot, limits = query.scene.robot_open, query.limits
    sides = [(grip_lines(robot, t.pick, limits), grip_lines(robot, t.place, limits)) for t in query.transfers]
    at_lines = [g for pair in sides for g in pair]
    return Bounds(
        _chain(
            query.q_start,
            at_lines,
            lambda q, g: straight_time(_offsets(g) - q, limits),
            lambda a, b: straight_time(_offsets(b)[None] - _offsets(a)[:, None], limits),
            lambda g: 2.0 * np.array([_line_time(one, limits) for one in g]),
        ),
        _chain(
            query.q_start,
            at_lines,
            lambda q, g: np.array([_free_time(np.vstack([q, one.q[::-1]]), limits) for one in g]),
            lambda a, b: np.array([[_free_time(np.vstack([x.q, y.q[::-1]]), limits) for y in b] for x in a]),
            lambda g: np.zeros(len(g)),
        ),
    )


def _chain(q_home, at_lines, end_time, between, stay) -> float:  # type: ignore[no-untyped-def]
    """Dynamic programming over the choices at each station in turn."""
    cost = end_time(q_home, at_lines[0]) + stay(at_lines[0])
    for before, after in itertools.pairwise(at_lines):
        cost = (cost[:, None] + between(before, after)).min(axis=0) + stay(after)
    return float((cost + end_time(q_home, at_lines[-1])).min())


def _offsets(lines: list[GripLine]) -> Array:
    return np.array([g.q_offset for g in lines])


def _line_time(line: GripLine, limits: Limits) -> float:
    trajectory = time_line(JointPath(line.q, np.linspace(0.0, OFFSET, len(line.q))), limits)
    return float(trajectory.times[-1]) / trajectory.stretch


def _free_time(q: Array, limits: Limits) -> float:
    """LB0 of one way from rest to rest through q (n, 6)."""
    steps = np.diff(q, axis=0)
    speed = float((np.abs(steps) / limits.velocity).max(axis=1).sum())
    slowest = 0.0
    for k in range(q.shape[1]):
        step = steps[:, k][steps[:, k] != 0.0]
        if not len(step):
            continue
        runs = np.add.reduceat(step, np.flatnonzero(np.diff(np.sign(step), prepend=0.0)))
        v, a = limits.velocity[k], limits.acceleration[k]
        d = np.abs(runs)
        slowest = max(slowest, float(np.where(d * a > v * v, d / v + v / a, 2.0 * np.sqrt(d / a)).sum()))
    return max(speed, slowest)
