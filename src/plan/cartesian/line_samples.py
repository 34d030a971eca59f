"""Samples of the free directions along a line, chained by the least motion: an initial guess for bent lines.

Barriers prevent steps that come too near, but do not show on which side of a body there is room. So configurations are
sampled at stations along the line. At the start, steps along the null space of the tool's task give a row of samples;
each is continued from station to station. Dynamic programming chooses one clear sample per station (as in ladder
graphs: Descartes, ROS-Industrial). The result is a guess for the follower with barriers, not a path.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator

from arm.controller.unit import Limits
from arm.numerics.products import mul, norm, solve_positive
from arm.robot.model import Robot
from arm.se3 import Array, Bools
from plan.collision.world import World
from plan.kinematics.numeric_ik import solutions_near
from plan.kinematics.straight_line import Line

_APART = 0.01  # m of tool travel, or
_TURNED = 0.1  # rad, between stations
_STEP = 0.1  # rad (m for a prismatic joint) between neighbouring samples
_EACH_WAY = 32  # samples on either side of the start
_JUMP = 0.45  # rad, largest motion of a joint between stations
_BETWEEN = (0.5, 0.25, 0.75)  # places between stations that are checked
_TRIES = 40  # chains


class LineSamples:
    """Samples along one line.

    Args:
        robot: the arm.
        q_start: (n,) rad, at the start of the line.
        line, limits: as in `plan.cartesian.line.follow_line`.
        free_axis: see `plan.cartesian.differential_ik.LineOptions`.
    """

    def __init__(
        self, robot: Robot, q_start: Array, line: Line, limits: Limits, free_axis: str | None
    ) -> None:
        count = int(np.ceil(max(line.length / _APART, float(norm(line.turn)) / _TURNED)))
        self.fractions = np.linspace(0.0, 1.0, max(4, count) + 1)
        free = [f"r{axis}" for axis in free_axis or ""]
        self.q, self.reached = _rungs(robot, q_start, line.poses(self.fractions), limits, free)
        steps = self.q[1:, None] - self.q[:-1, :, None]  # (stations - 1, from, to, n)
        self.cost = np.round((steps**2).sum(axis=-1), 9)
        self.cost[np.abs(steps).max(axis=-1) > _JUMP] = np.inf

    def way(self, world: World, clearance: float, end_clearance: float) -> Callable[[float], Array] | None:
        """Return clear configurations as a function of the fraction of the line; None if no chain of samples is clear.

        Args:
            world: the arm and all bodies.
            clearance, end_clearance: required clearances on the line and at its end, m.
        """
        too_near, on = world.too_near(clearance), self.reached.copy()
        for i in range(1, len(on)):
            test = too_near if i + 1 < len(on) else world.too_near(end_clearance)
            on[i] = [reached and not test(q) for q, reached in zip(self.q[i], on[i], strict=True)]
        cost = np.where(on[:-1, :, None] & on[1:, None], self.cost, np.inf)
        for _ in range(_TRIES):
            chain = _cheapest(cost)
            if chain is None:
                break
            q = self.q[np.arange(len(on)), chain]
            blocked = [
                i for i, (a, b) in enumerate(pairwise(q)) if any(too_near(a + u * (b - a)) for u in _BETWEEN)
            ]
            if not blocked:
                way = PchipInterpolator(self.fractions, q)
                return lambda fraction: np.asarray(way(fraction))
            for i in blocked:
                cost[i, chain[i], chain[i + 1]] = np.inf
        return None


def _rungs(robot: Robot, q_start: Array, T: Array, limits: Limits, free: list[str]) -> tuple[Array, Bools]:
    """Return samples (stations, k, n) and whether each is a solution; the first of every row continues `q_start`."""
    box = limits.lower, limits.upper
    row = [q_start]
    for direction in _null_space(robot, q_start, free):
        for side in (direction, -direction):
            q, along = q_start, side
            for _ in range(_EACH_WAY):
                found, met = solutions_near(robot, (q + _STEP * along)[None], T[:1], *box, free)
                moved = found[0] - q
                size = float(norm(moved))
                if not met[0] or not 0.3 * _STEP < size < 3.0 * _STEP:
                    break
                q, along = found[0], moved / size
                row.append(q)
    rungs = np.empty((len(T), len(row), len(q_start)))
    on = np.ones(rungs.shape[:2], dtype=bool)
    rungs[0], on[0, 1:] = row, False
    for i in range(1, len(T)):
        pose = np.broadcast_to(T[i], (len(row), 4, 4))
        rungs[i], on[i] = solutions_near(robot, rungs[i - 1], pose, *box, free)
        on[i] &= np.abs(rungs[i] - rungs[i - 1]).max(axis=1) <= _JUMP
    return rungs, on


def _null_space(robot: Robot, q: Array, free: list[str]) -> list[Array]:
    """Return orthogonal unit vectors (n,) of joint motions that keep what is not free of the tool."""
    held = [r for r in range(6) if r < 3 or "rxryrz"[2 * (r - 3) : 2 * (r - 2)] not in free]
    J = robot.jacobian(q)[held]
    n = len(q)
    H = mul(J, J.T) + 1e-10 * np.eye(len(J))
    P = np.eye(n) - mul(J.T, np.stack([solve_positive(H, column) for column in J.T], axis=1))
    found: list[Array] = []
    for _ in range(n - len(held)):
        joint = int(np.argmax(np.round(np.diag(P), 6)))
        size = float(np.sqrt(max(P[joint, joint], 0.0)))
        if size < 1e-3:
            break
        direction = P[joint] / size
        found.append(direction / norm(direction))
        P = P - direction[:, None] * direction
    return found


def _cheapest(cost: Array) -> list[int] | None:
    """Return one sample for each station such that the sum of the costs (stations - 1, from, to) is least."""
    least = np.full(cost.shape[1], np.inf)
    least[0] = 0.0
    back = []
    for step in cost:
        total = least[:, None] + step
        back.append(np.argmin(total, axis=0))
        least = total.min(axis=0)
    at = int(np.argmin(least))
    if not np.isfinite(least[at]):
        return None
    chain = [at]
    for best in reversed(back):
        chain.insert(0, int(best[chain[0]]))
    return chain
