"""Lower bounds on motion time with nothing in the way.

LB: rest at home, at every offset point and at every station; straight synchronised trapezoids between, lines timed
under joint limits alone; the best over all yaws and branches. Motion that does not stop at offset points can beat it.

LB1: what no motion from home to the grasps, to the places and home can beat that rests where the gripper acts, whatever
it does between: every joint alone, from rest to rest, as if it never had to wait for another. Nobody undercuts it.

LB0: what no motion can beat that goes through the offset points, along the lines, and rests where the gripper acts.
Between two rests, each joint goes through known values in order. The time is at least (1) the sum over steps between
those of the slowest joint's at full speed, and (2) for each joint, the time of its own fastest motion through them: it
stops wherever its direction turns, because a turn beyond a forced value only makes both ways longer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise, permutations, product

import numpy as np
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.trajectory.time_estimates import straight_time
from plan.trajectory.timing import time_curve
from planning_bench.grips import GripLine, grip_lines
from planning_bench.query import OFFSET, Query


@dataclass(frozen=True)
class Bounds:
    """Of one query, s."""

    LB: float
    LB0: float
    LB1: float


def bounds(query: Query, free: bool = True) -> Bounds:
    """All bounds, best over yaws and branches along the whole chain of transfers.

    Args:
        query: whose transfers.
        free: whether order and assignment are free too (every cube to every place, in every order).
    """
    robot, limits = query.scene.robot_open, query.limits
    picks = [grip_lines(robot, t.pick, limits) for t in query.transfers]
    places = [grip_lines(robot, t.place, limits) for t in query.transfers]

    def rest_times(a: Lines, b: Lines) -> Array:
        return straight_time(_offsets(b)[None] - _offsets(a)[:, None], limits)

    def free_times(a: Lines, b: Lines) -> Array:
        return np.array([[_free_time(np.vstack([x.q, y.q[::-1]]), limits) for y in b] for x in a])

    def alone_times(a: Lines, b: Lines) -> Array:
        steps = np.array([y.q_station for y in b])[None] - np.array([x.q_station for x in a])[:, None]
        return np.asarray(_rest_to_rest(np.abs(steps), limits.velocity, limits.acceleration).max(axis=-1))

    def line_times(lines: Lines) -> Array:
        return 2.0 * np.array([_line_time(one, limits) for one in lines])

    home = [GripLine(0, query.q_start[None])]
    return Bounds(
        _best(_Legs(home, picks, places, rest_times, line_times), free),
        _best(_Legs(home, picks, places, free_times, lambda lines: np.zeros(len(lines))), free),
        _best(_Legs(home, picks, places, alone_times, lambda lines: np.zeros(len(lines))), free),
    )


Lines = list[GripLine]


class _Legs:
    """Times between the grips of any two stations, computed when first asked for."""

    def __init__(
        self,
        home: Lines,
        picks: list[Lines],
        places: list[Lines],
        between: Callable[[Lines, Lines], Array],
        stay: Callable[[Lines], Array],
    ) -> None:
        self.count = len(picks)
        self._between = between
        self._lines = {("home", 0): home}
        self._lines |= {("pick", i): lines for i, lines in enumerate(picks)}
        self._lines |= {("place", j): lines for j, lines in enumerate(places)}
        self._stay = {k: stay(v) if k[0] != "home" else np.zeros(1) for k, v in self._lines.items()}
        self._known: dict[tuple[Stop, Stop], Array] = {}

    def __call__(self, a: Stop, b: Stop) -> Array:
        if (a, b) not in self._known:
            self._known[a, b] = self._between(self._lines[a], self._lines[b]) + self._stay[b]
        return self._known[a, b]


Stop = tuple[str, int]


def _best(legs: _Legs, free: bool) -> float:
    """Dynamic programming over the choices at each station in turn, for each order and assignment that is allowed."""
    every = [tuple(range(legs.count))]
    orders = list(permutations(range(legs.count))) if free else every
    home: Stop = ("home", 0)
    best = np.inf
    for order, targets in product(orders, orders):
        stops = [stop for i, j in zip(order, targets, strict=True) for stop in (("pick", i), ("place", j))]
        cost = np.zeros(1)
        for a, b in pairwise([home, *stops, home]):
            cost = (cost[:, None] + legs(a, b)).min(axis=0)
        best = min(best, float(cost[0]))
    return best


def _offsets(lines: list[GripLine]) -> Array:
    return np.array([g.q_offset for g in lines])


def _line_time(line: GripLine, limits: Limits) -> float:
    trajectory = time_curve(CubicSpline(np.linspace(0.0, OFFSET, len(line.q)), line.q), limits)
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
        rests = _rest_to_rest(np.abs(runs), limits.velocity[k], limits.acceleration[k])
        slowest = max(slowest, float(rests.sum()))
    return max(speed, slowest)


def _rest_to_rest(way: Array, velocity: Array, acceleration: Array) -> Array:
    """Least times (...) s of joints that move by `way` (...) >= 0 rad from rest to rest."""
    v, a = velocity, acceleration
    return np.asarray(np.where(way * a > v * v, way / v + v / a, 2.0 * np.sqrt(way / a)))
