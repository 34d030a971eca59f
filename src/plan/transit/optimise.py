"""Path optimisation: sequential quadratic programming moves the corners of a path to make it faster.

A path is straight in joint space between its way-points. Let y be the displacements of the inner way-points, in seconds
of travel at each joint's velocity limit, tau the durations of the edges, and sigma the durations of the velocity
changes at way-points. Each step solves

    minimise    sum tau + sum sigma + mu xi + small |y|^2
    subject to  |travel of joint k on edge i| <= velocity_k tau_i
                |jump of velocity of joint k at way-point i| <= 2 acceleration_k sigma_i       (linearised)
                distance + gradient . motion >= clearance - xi                                (linearised)
                joint limits, and a trust region about the present path

with signed distances at places along the edges (J. Schulman et al., "Motion planning with sequential convex
optimization and convex collision checking", IJRR 2014, with time as the objective).

Samples check the result of a step. Where it is blocked, half of the step is tried, which costs no program. If that is
blocked too, distances at the blocked places join the model, measured where the step and its half lead: what is met
there may be too far from the present path to be seen from it. The next step has a smaller trust region.

The samples of the final path are finer, so that nearly all of these paths can be certified, which the caller does.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil

import numpy as np
import qpsolvers

from arm.controller.unit import Limits
from arm.se3 import Array, Indices, frozen
from plan.budget import QP_CHECKS, spend
from plan.collision.world import World
from plan.trajectory.time_estimates import path_time, straight_time

_GOOD_ENOUGH = 1.002  # optimisation ends at this multiple of the straight motion's duration
_WORTH = 1e-3  # least useful gain of a step, relative to the path's duration
_INFLUENCE = 0.04  # m beyond the clearance: pairs further apart do not constrain a step
_EXTRA = 1e-3  # m added to the clearance where distances are linearised
_PENALTY = 1e3  # s per m of missing clearance
_SMALL = 1e-3  # weight of |y|^2, which keeps the quadratic program well conditioned
_SAMPLE_TRAVEL = 0.3  # rad summed over the joints, between the places of a step's constraints
# Distance of the samples of a step's result, and of the final path, rad summed over the joints.
_CHECK_TRAVEL, _FINE_TRAVEL = 0.15, 0.05
_MOST_SAMPLES = 6  # samples in collision that become constraints at once
_REGION, _LEAST_REGION = 1.0, 0.03  # s of travel, first and smallest trust region
_REPAIRS, _REPAIR_REGION = (
    2,
    0.1,
)  # steps that free the final path at its finer samples, and their trust region
_MOST_ON_EDGE = 120  # samples
_MOST_CORNERS = 4
_LARGEST = 16  # corners; a quadratic program of a longer path takes seconds


@dataclass(frozen=True)
class Ends:
    """Velocities (n,) rad/s at the start and end of a path; zero for rest."""

    enter: Array
    leave: Array


class TransitOptimiser:
    """Makes paths in one world faster.

    Args:
        world: bodies to avoid.
        limits: joint limits.
        clearance: required clearance, m.
        ends: velocities at both ends of the path.
    """

    def __init__(self, world: World, limits: Limits, clearance: float, ends: Ends) -> None:
        self.world, self.limits, self.clearance, self.ends = world, limits, clearance, ends

    def time(self, path: Array) -> float:
        """Estimate the duration of a path, s."""
        return path_time(path, self.limits, self.ends.enter, self.ends.leave)

    def shorten(self, path: Array, steps: int) -> Array | None:
        """Optimise a path (m, n) in at most `steps` steps.

        The result is checked at fine samples, not certified; None if no path is free there.
        """
        shortening = Shortening(self, path)
        shortening.run(steps)
        return shortening.settled()

    def blocked(
        self,
        path: Array,
        travel: float = _CHECK_TRAVEL,
        most: int = _MOST_SAMPLES,
        known: Array | None = None,
    ) -> list[tuple[int, float]]:
        """Return samples of a path (m, n) without the clearance: edge, and place on it (0 to 1).

        Args:
            path: way-points.
            travel: between samples, rad summed over the joints.
            most: no more than these are looked for.
            known: a path whose edges are clear; where the two are the same, nothing is looked at.
        """
        found, too_near = list[tuple[int, float]](), self.world.too_near(self.clearance)
        for i in range(len(path) - 1):
            if known is not None and np.array_equal(path[i : i + 2], known[i : i + 2]):
                continue
            step = path[i + 1] - path[i]
            count = min(max(ceil(np.abs(step).sum() / travel), 2), _MOST_ON_EDGE)
            places = np.arange(1, count + (i < len(path) - 2)) / count
            for j, q in enumerate(path[i] + places[:, None] * step):
                if too_near(q):
                    found.append((i, float(places[j])))
                    if len(found) >= most:
                        return found
        return found

    def with_corner(self, path: Array) -> Array | None:
        """Add a corner in the middle of the longest edge; return None if the path has too many."""
        if len(path) >= _MOST_CORNERS + 2:
            return None
        times = (np.abs(np.diff(path, axis=0)) / self.limits.velocity).max(axis=1)
        longest = int(np.argmax(np.round(times, 9)))
        return np.insert(path, longest + 1, (path[longest] + path[longest + 1]) / 2.0, axis=0)


class Shortening:
    """A path that is made faster in steps.

    Args:
        of: what it is optimised by.
        path: way-points (m, n) rad, clear at samples.

    Attributes:
        time: estimated duration of the present path, s.
    """

    def __init__(self, of: TransitOptimiser, path: Array) -> None:
        self.of, self.time = of, of.time(path)
        self._accepted = [path]
        self._floor = _GOOD_ENOUGH * float(straight_time(path[-1] - path[0], of.limits))
        self._region = _REGION
        self._model: _Model | None = None

    @property
    def path(self) -> Array:
        """The present path (m, n) rad."""
        return self._accepted[-1]

    def run(self, steps: int) -> None:
        """Do at most `steps` steps; further calls go on where the last one ended."""
        for _ in range(steps):
            if not 3 <= len(self.path) <= _LARGEST + 2 or self.time <= self._floor:
                return
            if self._region < _LEAST_REGION:
                finer = self.of.with_corner(self.path)
                if finer is None:
                    return
                self._accepted[-1], self._region, self._model = finer, _REGION / 2.0, None
            spend(QP_CHECKS)
            self._step()

    def settled(self) -> Array | None:
        """Return the path, freed at its finer samples; or the last one before it that is free there; or None."""
        *earlier, path = self._accepted
        before = self.of.time(earlier[-1]) if earlier else self.time
        for repair in range(_REPAIRS + 1):
            blocked = self.of.blocked(path, _FINE_TRAVEL)
            if not blocked:
                return path
            if repair == _REPAIRS:
                break
            model = _Model(self.of, path)
            model.constrain(blocked)
            trial = model.step(_REPAIR_REGION)
            if trial is None or not self._faster(trial, before):
                break
            path = trial
        return next((p for p in reversed(earlier) if not self.of.blocked(p, _FINE_TRAVEL, 1)), None)

    def _step(self) -> None:
        """Solve one quadratic program and accept its result, or half of its step, if that is clear and faster."""
        path = self.path
        model = self._model = self._model or _Model(self.of, path)
        trial = model.step(self._region)
        if trial is None or not self._faster(trial, self.time):
            self._region = 0.0
            return
        blocked = self.of.blocked(trial, known=path)
        half = path + 0.5 * (trial - path)
        if not blocked:
            self._accept(trial)
            self._region *= 1.5
        elif self._faster(half, self.time) and not self.of.blocked(half, most=1, known=path):
            self._accept(half)
        else:
            model.constrain(blocked, trial, half)
            self._region *= 0.5

    def _accept(self, path: Array) -> None:
        self._accepted.append(path)
        self.time, self._model = self.of.time(path), None

    def _faster(self, path: Array, time: float) -> bool:
        """Return whether a path takes so much less than `time` s that it is worth its change."""
        return time - self.of.time(path) >= _WORTH * time


class _Model:
    """Linear model of a path's neighbourhood: distances with gradients at places along its edges."""

    def __init__(self, of: TransitOptimiser, path: Array) -> None:
        self.of, self.path = of, path
        steps = np.abs(np.diff(path, axis=0)).sum(axis=1)
        counts = np.clip(np.ceil(steps / _SAMPLE_TRAVEL), 2, 7).astype(int)
        # inner places of each edge, and the way-point at its end except for the last edge
        last = len(counts) - 1
        places = [
            (i, (j + 1) / (n + 1)) for i, n in enumerate(counts.tolist()) for j in range(n + (i < last))
        ]
        self.edge = np.zeros(0, dtype=np.intp)
        self.rows = np.zeros((0, (len(path) - 2) * path.shape[1]))
        self.room = np.zeros(0)
        self.constrain(places)

    def constrain(self, places: list[tuple[int, float]], *trials: Array) -> None:
        """Add distances at these places: edge, and place on it (0 to 1).

        Args:
            places: k of them.
            trials: further paths on which the distances at the same places are measured too.
        """
        edges, fractions = np.array([i for i, _ in places]), np.array([u for _, u in places])
        paths, n = (self.path, *trials), self.path.shape[1]
        edge, u = np.tile(edges, len(paths)), np.tile(fractions, len(paths))[:, None]
        q = np.concatenate([_at(path, edges, fractions) for path in paths])
        near = self.of.world.near(q, self.of.clearance + _INFLUENCE)
        # the direction out of a body that is met is not to be trusted, because walls are thin
        trusted = (near.row < len(places)) | (near.distance > 0.0)
        row, gradient, distance = near.row[trusted], near.gradient[trusted], near.distance[trusted]
        moved = np.tile(q[: len(places)], (len(paths), 1)) - q
        corners = len(self.path) - 2
        rows = np.zeros((len(row), corners + 2, n))
        index = np.arange(len(row))
        e, f = edge[row], u[row]
        rows[index, e] = -(1 - f) * gradient
        rows[index, e + 1] = -f * gradient
        inner = (rows[:, 1:-1] * self.of.limits.velocity).reshape(len(index), corners * n)
        self.rows = np.concatenate([self.rows, inner])
        here = distance + (gradient * moved[row]).sum(axis=1)
        self.room = np.concatenate([self.room, here - (self.of.clearance + _EXTRA)])

    def step(self, region: float) -> Array | None:
        """Return the path after the best step within `region` s of travel of each joint; None if the solver fails."""
        path, limits, ends = self.path, self.of.limits, self.of.ends
        v, a = limits.velocity, limits.acceleration
        corners, n = len(path) - 2, path.shape[1]
        edges, moves = corners + 1, corners * n
        travel = np.diff(path, axis=0) / v  # s of travel
        tau = np.maximum(np.abs(travel).max(axis=1), 1e-3)
        size = moves + edges + (edges + 1) + 1
        at_tau, at_sigma, at_xi = moves, moves + edges, size - 1

        # velocity on each edge relative to its limit, and the derivatives; those at the ends are fixed
        D, edge_rows, jump_rows = _constant_rows(edges, n, size)
        speed = np.concatenate([[ends.enter / v], travel / tau[:, None], [ends.leave / v]])
        slope = np.zeros((edges + 2, n, size))
        slope[1:-1, :, :moves] = D / tau[:, None, None]
        every = np.arange(edges)
        slope[1 + every, :, at_tau + every] = -travel / tau[:, None] ** 2
        cost = 0.5 * v / a
        jump = (speed[1:] - speed[:-1]) * cost
        jump_slope = ((slope[1:] - slope[:-1]) * cost[:, None]).reshape(-1, size)
        sigma = np.abs(jump).max(axis=1)

        counts = np.cumsum([0, len(edge_rows), 2 * len(jump_slope), len(self.rows)])
        G, h = np.zeros((counts[-1], size)), np.empty(counts[-1])
        G[: counts[1]] = edge_rows
        h[: counts[1]] = np.concatenate([tau[:, None] - travel, tau[:, None] + travel]).ravel()
        jumps = G[counts[1] : counts[2]].reshape(2, -1, size)
        jumps[0], jumps[1] = jump_slope, -jump_slope
        jumps += jump_rows
        h[counts[1] : counts[2]] = np.concatenate([sigma[:, None] - jump, sigma[:, None] + jump]).ravel()
        G[counts[2] :, :moves], G[counts[2] :, at_xi] = self.rows, -1.0
        h[counts[2] :] = self.room

        P = np.full(size, 1e-4)
        P[:moves] = _SMALL
        linear = np.ones(size)
        linear[:moves], linear[at_xi] = 0.0, _PENALTY
        low, high = np.full(size, -1e3), np.full(size, 1e3)
        inner = path[1:-1]
        low[:moves] = np.maximum((limits.lower - inner) / v, -region).ravel()
        high[:moves] = np.minimum((limits.upper - inner) / v, region).ravel()
        low[at_tau:at_sigma] = 1e-3 - tau
        low[at_sigma:at_xi] = -sigma
        low[at_xi] = 0.0
        x = qpsolvers.solve_qp(np.diag(P), linear, G, h, lb=low, ub=high, solver="daqp")
        if x is None:
            return None
        trial = path.copy()
        trial[1:-1] = np.clip(inner + x[:moves].reshape(corners, n) * v, limits.lower, limits.upper)
        return trial


def _at(path: Array, edges: Indices, fractions: Array) -> Array:
    """Return configurations (k, n) of a path at places on its edges."""
    u = fractions[:, None]
    return np.asarray((1 - u) * path[edges] + u * path[edges + 1])


@lru_cache(maxsize=32)
def _constant_rows(edges: int, n: int, size: int) -> tuple[Array, Array, Array]:
    """Return the parts of the constraints that depend on the number of edges and joints only.

    Returns:
        Travel of each joint on each edge as rows on y, (edges, n, moves); rows ``|travel| <= tau``, (2 edges n, size);
        and the entries of sigma in the rows of the velocity jumps, ((edges + 1) n, size).
    """
    moves = (edges - 1) * n
    every = np.arange(edges)
    difference = np.kron(np.diff(np.eye(edges + 1), axis=0), np.eye(n)) + 0.0  # + 0.0 makes -0.0 into 0.0
    D = difference[:, n:-n].reshape(edges, n, moves)
    travel = np.zeros((2, edges, n, size))
    travel[0, ..., :moves], travel[1, ..., :moves] = D, -D
    travel[:, every, :, moves + every] = -1.0
    jumps = np.zeros((edges + 1, n, size))
    jumps[np.arange(edges + 1), :, moves + edges + np.arange(edges + 1)] = -1.0
    return frozen(D), frozen(travel.reshape(-1, size)), frozen(jumps.reshape(-1, size))
