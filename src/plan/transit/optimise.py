"""Shorter ways in time: the corners of a proved way are moved by sequential quadratic programming.

A way is straight in joint space between its way-points. With y the moves of the inner way-points, in seconds of travel
at each joint's full speed, tau the edges' times and sigma the times that the turns at way-points cost, each step solves

    minimise    sum tau + sum sigma + mu xi + small |y|^2
    subject to  |way of joint k on edge i| <= velocity_k tau_i
                |jump of velocity of joint k at way-point i| <= 2 acceleration_k sigma_i       (linearised)
                distance + gradient . motion >= clearance - xi                                (linearised)
                joint limits, and a region of trust about the way so far

where distances are signed and taken at places along the edges (J. Schulman et al., "Motion planning with sequential
convex optimization and convex collision checking", IJRR 2014, with time as the objective). A step is
judged by samples, which is cheap and nearly always right; whoever uses the outcome proves it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil

import numpy as np
import qpsolvers

from arm.controller.unit import Limits
from arm.se3 import Array, frozen
from plan.budget import STEP_LOOKS, spend
from plan.collision.world import World
from plan.trajectory.time_estimates import path_time, straight_time

# Times at which a way is near enough to the straight move's, and gains that are worth a step, in parts of its time.
_GOOD_ENOUGH = 1.002
_WORTH = 1e-3
# Pairs further than this beyond the clearance do not matter to a step, m.
_INFLUENCE = 0.04
# What is asked on top of the clearance where distances are linearised, m.
_EXTRA = 1e-3
_PENALTY = 1e3  # s per m of clearance that is missing
_SMALL = 1e-3
_SAMPLE_TRAVEL = 0.3  # rad summed over the joints between places that a step looks at
_CHECK_TRAVEL = 0.15  # and between those where its outcome is sampled
_MOST_SAMPLES = 6  # not clear, that a step is told at once
_REGION, _LEAST_REGION = 1.0, 0.03  # s of travel
_MOST_CORNERS = 4


@dataclass(frozen=True)
class Ends:
    """Velocities (n,) rad/s with which a way is entered and left; zero where it begins or ends at rest."""

    enter: Array
    leave: Array


class Shortener:
    """Makes ways through one world faster.

    Args:
        world: what is in the way.
        limits: of the joints.
        clearance: asked for, m.
        ends: velocities at both ends of the way.
    """

    def __init__(self, world: World, limits: Limits, clearance: float, ends: Ends) -> None:
        self.world, self.limits, self.clearance, self.ends = world, limits, clearance, ends

    def time(self, way: Array) -> float:
        """Estimate in s, turns included."""
        return path_time(way, self.limits, self.ends.enter, self.ends.leave)

    def shorten(self, way: Array, steps: int) -> Array:
        """The way (m, n) made faster in at most `steps` steps; judged by samples, so it is still to be proved."""
        floor = _GOOD_ENOUGH * float(straight_time(way[-1] - way[0], self.limits))
        region, time = _REGION, self.time(way)
        model: _Model | None = None
        for _ in range(steps):
            if len(way) < 3 or time <= floor:
                break
            if region < _LEAST_REGION:
                finer = self.with_corner(way)
                if finer is None:
                    break
                way, region, model = finer, _REGION / 2.0, None
            spend(STEP_LOOKS)
            model = model or _Model(self, way)
            trial = model.step(region)
            gained = 0.0 if trial is None else time - self.time(trial)
            if trial is None or gained < _WORTH * time:
                region = 0.0
                continue
            blocked = self.blocked(way, trial)
            if not blocked:
                way, time, model = trial, time - gained, None
                region *= 1.5
            else:
                model.look_at(blocked)
                region *= 0.5
        return way

    def blocked(self, way: Array, trial: Array) -> list[tuple[int, float]]:
        """Samples of the moved edges that are not clear: edge, and place on it (0 to 1)."""
        found, too_near = [], self.world.too_near(self.clearance)
        for i in range(len(trial) - 1):
            a, b = trial[i], trial[i + 1]
            if np.array_equal(trial[i : i + 2], way[i : i + 2]):
                continue
            step = b - a
            count = min(max(ceil(np.abs(step).sum() / _CHECK_TRAVEL), 2), 40)
            for j in range(1, count + (i < len(trial) - 2)):
                if too_near(a + (j / count) * step):
                    found.append((i, j / count))
                    if len(found) >= _MOST_SAMPLES:
                        return found
        return found

    def with_corner(self, way: Array) -> Array | None:
        """The same way with one more corner, in the middle of its longest edge."""
        if len(way) >= _MOST_CORNERS + 2:
            return None
        times = (np.abs(np.diff(way, axis=0)) / self.limits.velocity).max(axis=1)
        longest = int(np.argmax(np.round(times, 9)))
        return np.insert(way, longest + 1, (way[longest] + way[longest + 1]) / 2.0, axis=0)


class _Model:
    """The way's neighbourhood: distances with gradients at places along its edges."""

    def __init__(self, of: Shortener, way: Array) -> None:
        self.of, self.way = of, way
        steps = np.abs(np.diff(way, axis=0)).sum(axis=1)
        counts = np.clip(np.ceil(steps / _SAMPLE_TRAVEL), 2, 7).astype(int)
        # inner places of every edge, and the inner way-points at the end of each but the last
        last = len(counts) - 1
        places = [
            (i, (j + 1) / (n + 1))
            for i, n in enumerate(counts)
            for j in range(int(n) + (1 if i < last else 0))
        ]
        self.edge = np.zeros(0, dtype=np.intp)
        self.rows = np.zeros((0, (len(way) - 2) * way.shape[1]))
        self.room = np.zeros(0)
        self._look(np.array([i for i, _ in places]), np.array([u for _, u in places]))

    def look_at(self, places: list[tuple[int, float]]) -> None:
        """Add places that turned out to matter."""
        self._look(np.array([i for i, _ in places]), np.array([u for _, u in places]))

    def _look(self, edge: Array, place: Array) -> None:
        way, n = self.way, self.way.shape[1]
        u = place[:, None]
        near = self.of.world.near((1 - u) * way[edge] + u * way[edge + 1], self.of.clearance + _INFLUENCE)
        corners = len(way) - 2
        rows = np.zeros((len(near.row), corners + 2, n))
        index = np.arange(len(near.row))
        e, f = edge[near.row], place[near.row][:, None]
        rows[index, e] = -(1 - f) * near.gradient
        rows[index, e + 1] = -f * near.gradient
        inner = (rows[:, 1:-1] * self.of.limits.velocity).reshape(len(index), corners * n)
        self.rows = np.concatenate([self.rows, inner])
        self.room = np.concatenate([self.room, near.distance - (self.of.clearance + _EXTRA)])

    def step(self, region: float) -> Array | None:
        """The way after the best step within `region` s of travel of each joint; None if the solver finds none."""
        way, limits, ends = self.way, self.of.limits, self.of.ends
        v, a = limits.velocity, limits.acceleration
        corners, n = len(way) - 2, way.shape[1]
        edges, moves = corners + 1, corners * n
        ways = np.diff(way, axis=0) / v  # s of travel
        tau = np.maximum(np.abs(ways).max(axis=1), 1e-3)
        size = moves + edges + (edges + 1) + 1
        at_tau, at_sigma, at_xi = moves, moves + edges, size - 1

        # velocity on every edge over full speed, and its derivatives; the ways in and out are given
        D, edge_rows, turn_rows = _constant_rows(edges, n, size)
        speed = np.concatenate([[ends.enter / v], ways / tau[:, None], [ends.leave / v]])
        slope = np.zeros((edges + 2, n, size))
        slope[1:-1, :, :moves] = D / tau[:, None, None]
        every = np.arange(edges)
        slope[1 + every, :, at_tau + every] = -ways / tau[:, None] ** 2
        cost = 0.5 * v / a
        jump = (speed[1:] - speed[:-1]) * cost
        jump_slope = ((slope[1:] - slope[:-1]) * cost[:, None]).reshape(-1, size)
        sigma = np.abs(jump).max(axis=1)

        counts = np.cumsum([0, len(edge_rows), 2 * len(jump_slope), len(self.rows)])
        G, h = np.zeros((counts[-1], size)), np.empty(counts[-1])
        G[: counts[1]] = edge_rows
        h[: counts[1]] = np.concatenate([tau[:, None] - ways, tau[:, None] + ways]).ravel()
        turns = G[counts[1] : counts[2]].reshape(2, -1, size)
        turns[0], turns[1] = jump_slope, -jump_slope
        turns += turn_rows
        h[counts[1] : counts[2]] = np.concatenate([sigma[:, None] - jump, sigma[:, None] + jump]).ravel()
        G[counts[2] :, :moves], G[counts[2] :, at_xi] = self.rows, -1.0
        h[counts[2] :] = self.room

        P = np.full(size, 1e-4)
        P[:moves] = _SMALL
        linear = np.ones(size)
        linear[:moves], linear[at_xi] = 0.0, _PENALTY
        low, high = np.full(size, -1e3), np.full(size, 1e3)
        inner = way[1:-1]
        low[:moves] = np.maximum((limits.lower - inner) / v, -region).ravel()
        high[:moves] = np.minimum((limits.upper - inner) / v, region).ravel()
        low[at_tau:at_sigma] = 1e-3 - tau
        low[at_sigma:at_xi] = -sigma
        low[at_xi] = 0.0
        x = qpsolvers.solve_qp(np.diag(P), linear, G, h, lb=low, ub=high, solver="daqp")
        if x is None:
            return None
        trial = way.copy()
        trial[1:-1] = np.clip(inner + x[:moves].reshape(corners, n) * v, limits.lower, limits.upper)
        return trial


@lru_cache(maxsize=32)
def _constant_rows(edges: int, n: int, size: int) -> tuple[Array, Array, Array]:
    """Parts of the constraints that hang on the number of edges and joints alone.

    Returns:
        way of every joint on every edge as rows on y, (edges, n, moves); rows ``|way| <= tau``, (2 edges n, size);
        and where each sigma stands in the rows of the turns, ((edges + 1) n, size).
    """
    moves = (edges - 1) * n
    difference = np.zeros((edges, n, edges + 1, n))
    joint, every = np.arange(n), np.arange(edges)
    for i in range(edges):
        difference[i, joint, i + 1, joint] = 1.0
        difference[i, joint, i, joint] = -1.0
    D = difference[:, :, 1:-1].reshape(edges, n, moves)
    ways = np.zeros((2, edges, n, size))
    ways[0, ..., :moves], ways[1, ..., :moves] = D, -D
    ways[:, every, :, moves + every] = -1.0
    turns = np.zeros((edges + 1, n, size))
    turns[np.arange(edges + 1), :, moves + edges + np.arange(edges + 1)] = -1.0
    return frozen(D), frozen(ways.reshape(-1, size)), frozen(turns.reshape(-1, size))
