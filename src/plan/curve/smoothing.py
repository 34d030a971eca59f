"""Smoothing of a chain along a curve: sequential quadratic programs over the free directions of all stations.

The tool stays on the curve, since the joints follow from the coordinates. Each step is the solution of a quadratic
program (`plan.curve.step_program`) within a trust region; it is taken if it is clear and worth it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits
from arm.numerics.products import mul, solve_positive
from arm.robot.model import Robot
from arm.se3 import Array, Bools, frozen
from plan.budget import QP_CHECKS, spend
from plan.collision.world import Near, World
from plan.curve.step_program import Rows, StepProgram
from plan.curve.tool_curve import ToolCurve, directions
from plan.kinematics.numeric_ik import solutions_near
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.trajectory.time_estimates import path_time

_ROOM = 0.15  # of a coordinate's limits at either end, for what lies between stations
_TURN, _SHIFT = 0.25, 0.006  # rad and m, first trust region
_LEAST_REGION = 0.02  # of the first trust region
_PARTS = (1.0, 0.5)  # of a step that are tried
_INFLUENCE = 0.015  # m beyond the clearance, of pairs that constrain a step, and
_AHEAD = 0.01  # m beyond the least distance, if that is maximised
_AIM = 3e-4  # m, added to the clearance where distances are linearised
_NEAR_LIMIT = 0.3  # rad from a joint limit that constrains a step
_JOINT_ROOM = 1e-3  # rad (m) kept to joint limits: for a step's curvature and what is between stations
_PROBE = 1e-6  # rad or m, of the derivative by the coordinates
_WORTH = 4e-3  # least useful gain of a step, relative
_WORTH_M = 1.5e-4  # m, least useful gain of distance
FARTHEST = 0.04  # m, distances beyond which more is no gain


@dataclass(frozen=True, eq=False)
class Followed:
    """Configurations along a curve.

    Attributes:
        places: (m,) on the curve, m.
        coordinates: (m, 6) of the free directions there.
        q: (m, n) rad.
    """

    places: Array
    coordinates: Array
    q: Array

    @property
    def all_q(self) -> Array:
        """The stations, then the middles between them, (2 m - 1, n) rad."""
        return np.concatenate([self.q, 0.5 * (self.q[1:] + self.q[:-1])])


@dataclass(frozen=True, eq=False)
class Widening:
    """Pairs (p,) of the world whose least distance is maximised; those farther than `farthest` m do not matter."""

    pairs: Bools
    farthest: float = FARTHEST


@dataclass(frozen=True, eq=False)
class Demand:
    """A clearance, m, that pairs (p,) of the world have to keep."""

    clearance: float
    pairs: Bools

    def of(self, near: Near, beyond: float) -> Bools:
        """Return which near pairs (r,) are its own, and nearer than the clearance and `beyond` m."""
        return np.asarray(self.pairs[near.pair] & (near.distance < self.clearance + beyond))


class Smoothing:
    """Smooths the way of the joints along one curve.

    Args:
        robot: the arm.
        curve: what the tool follows.
        world: the arm and all bodies.
        demands: clearances to keep.
        limits: of the joints.
        fixed: whether the first station stays as it is.
    """

    def __init__(
        self,
        robot: Robot,
        curve: ToolCurve,
        world: World,
        demands: Sequence[Demand],
        limits: Limits,
        fixed: bool = False,
    ) -> None:
        self.fixed = fixed
        self.robot, self.curve, self.world, self.limits = robot, curve, world, limits
        self.demands = tuple(demands)
        self.arm = product_of_exponentials(robot)
        self.columns = directions(curve)
        low, high = (some[self.columns] for some in curve.box())
        room = np.where(np.isinf(high), 0.0, _ROOM * (high - low))
        self.low, self.high, self.room, self.tilt = low, high, room, curve.freedom.tilt
        self._seen: tuple[Followed, Widening | None, Near] | None = None

    def at(self, places: Array, coordinates: Array, q: Array) -> Followed | None:
        """Return configurations near q (m, n) with these coordinates; None if there are none within limits."""
        T = self.curve.placed(places, coordinates)
        found, met = solutions_near(self.robot, q, T, self.limits.lower, self.limits.upper)
        if not met.all() or np.abs(found - q).max() > 0.5:
            return None
        return Followed(frozen(places), frozen(coordinates), frozen(found))

    def finer(self, way: Followed, steps: Bools) -> Followed | None:
        """Return the way with a station in the middle of some steps (m - 1,).

        The coordinates there follow the spline through those of the way. None if a station is out of reach.
        """
        after = np.flatnonzero(steps) + 1
        middles = 0.5 * (way.places[after] + way.places[after - 1])
        between = CubicSpline(way.places, way.coordinates)(middles)
        self._within(between)
        q = CubicSpline(way.places, way.q)(middles)
        merged = [
            np.insert(old, after, new, axis=0)
            for old, new in ((way.places, middles), (way.coordinates, between), (way.q, q))
        ]
        return self.at(*merged)

    def _within(self, coordinates: Array) -> None:
        """Move coordinates (m, 6) into their limits, in place."""
        coordinates[:, self.columns] = np.clip(coordinates[:, self.columns], self.low, self.high)
        tilt = self.tilt
        if tilt > 0.0:
            swing = np.sqrt((coordinates[:, 3:5] ** 2).sum(axis=1, keepdims=True))
            coordinates[:, 3:5] *= np.minimum(1.0, tilt / np.maximum(swing, 1e-12))

    def blocked(self, way: Followed, widened: Widening | None = None) -> bool:
        """Return whether a station, or the middle between two, is too near to something."""
        near = self._near(way, widened)
        return any(demand.of(near, 0.0).any() for demand in self.demands)

    def least(self, way: Followed, pairs: Bools) -> float:
        """Return the least distance of pairs (p,) at stations and middles, m, at most `FARTHEST`."""
        return self._least(way, Widening(pairs))

    def _least(self, way: Followed, widened: Widening) -> float:
        near = self._near(way, widened)
        return float(near.distance[widened.pairs[near.pair]].min(initial=widened.farthest))

    def _near(self, way: Followed, widened: Widening | None) -> Near:
        """Return the near pairs at stations and middles that demands or what is widened need; of the last way, kept."""
        if self._seen is None or self._seen[0] is not way or self._seen[1] is not widened:
            limits = np.full(len(self.world.pairs), -np.inf)
            if widened is not None:
                limits[widened.pairs] = widened.farthest
            for demand in self.demands:
                np.maximum(limits, demand.clearance + _INFLUENCE, out=limits, where=demand.pairs)
            self._seen = way, widened, self.world.near(way.all_q, limits)
        return self._seen[2]

    def time(self, way: Followed) -> float:
        """Estimate the time of a way, s."""
        return path_time(way.q, self.limits)

    def smoothed(self, way: Followed, rounds: int, turns_only: bool = False) -> Followed:
        """Return a faster way that is clear at its stations; the same if none is found.

        With `turns_only` free positions stay as they are.
        """
        if not self.columns:
            return way
        return self._better(way, rounds, None, turns_only)

    def widened(self, way: Followed, rounds: int, of: Bools) -> Followed:
        """Return a way with more distance between some pairs (p,), which also keeps all demands."""
        return self._better(way, rounds, Widening(of)) if self.columns else way

    def _better(
        self, way: Followed, rounds: int, widened: Widening | None, turns_only: bool = False
    ) -> Followed:
        """Return a way of larger value that is clear at its stations; the same if none is found.

        Args:
            way: where to begin.
            rounds: largest number of quadratic programs.
            widened: whose least distance is the value; None: the value is the time, negative.
            turns_only: whether free positions stay as they are.
        """
        value, region = self._value(way, widened), 1.0
        program = self._program(way, widened)
        for _ in range(rounds):
            if region < _LEAST_REGION:
                break
            spend(QP_CHECKS)
            step = self._step(way, program, region, turns_only)
            if step is None:
                break
            for part in _PARTS:
                trial = self._moved(way, program.D, part * step)
                if trial is None:
                    continue
                more = self._value(trial, widened) - value
                worth = _WORTH * -value if widened is None else _WORTH_M
                if more > worth and not self.blocked(trial, widened):
                    way, value, program = trial, value + more, self._program(trial, widened)
                    region = min(1.0, 1.5 * part * region)
                    if widened is not None:
                        widened = replace(widened, farthest=min(FARTHEST, value + _AHEAD))
                    break
            else:
                region *= 0.3
        return way

    def _value(self, way: Followed, widened: Widening | None) -> float:
        return -self.time(way) if widened is None else self._least(way, widened)

    def _moved(self, way: Followed, D: Array, step: Array) -> Followed | None:
        coordinates = np.array(way.coordinates)
        coordinates[:, self.columns] += step
        self._within(coordinates)
        guess = way.q + mul(D, step[..., None])[..., 0]
        return self.at(way.places, coordinates, np.clip(guess, self.limits.lower, self.limits.upper))

    def _derivatives(self, way: Followed) -> Array:
        """Return the derivative (m, n, f) of the joints by the free coordinates."""
        T = self.curve.placed(way.places, way.coordinates)
        J = self.arm.jacobians(way.q)
        twists = np.empty((len(T), 6, len(self.columns)))
        for k, column in enumerate(self.columns):
            shifted = np.array(way.coordinates)
            shifted[:, column] += _PROBE
            there = self.curve.placed(way.places, shifted)
            twists[:, :3, k] = (there[:, :3, 3] - T[:, :3, 3]) / _PROBE
            turned = mul(there[:, :3, :3], np.swapaxes(T[:, :3, :3], 1, 2))
            # of a small rotation, the vector of its skew part
            twists[:, 3, k] = 0.5 * (turned[:, 2, 1] - turned[:, 1, 2]) / _PROBE
            twists[:, 4, k] = 0.5 * (turned[:, 0, 2] - turned[:, 2, 0]) / _PROBE
            twists[:, 5, k] = 0.5 * (turned[:, 1, 0] - turned[:, 0, 1]) / _PROBE
        JT = np.swapaxes(J, 1, 2)
        H = mul(J, JT) + 1e-9 * np.eye(6)
        columns = [
            mul(JT, solve_positive(H, twists[..., k])[..., None])[..., 0] for k in range(len(self.columns))
        ]
        return np.stack(columns, axis=-1)

    def _program(self, way: Followed, widened: Widening | None) -> StepProgram:
        """Return the program of steps from a way: the fastest, or those to the largest least distance."""
        D, near, rows = self._derivatives(way), self._near(way, widened), []
        for demand in self.demands:
            own = near.chosen(demand.of(near, _INFLUENCE))
            rows.append(Rows.of_distances(own, D, own.distance - (demand.clearance + _AIM), True))
        if widened is not None:
            own = near.chosen(widened.pairs[near.pair])
            rows.append(Rows.of_distances(own, D, own.distance, False))
        if self.tilt > 0.0:
            rows.append(self._tilts(way))
        v = self.limits.velocity
        return StepProgram(D, np.diff(way.q, axis=0) / v, v, rows, widened is not None)

    def _step(self, way: Followed, program: StepProgram, region: float, turns_only: bool) -> Array | None:
        """Return the best change (m, f) of the free coordinates within a trust region; None if there is none."""
        shifts = np.array(self.columns) < 3
        trust = region * np.where(shifts, _SHIFT, _TURN)
        at = way.coordinates[:, self.columns]
        low = np.maximum(np.minimum(self.low + self.room - at, 0.0), -trust)
        high = np.minimum(np.maximum(self.high - self.room - at, 0.0), trust)
        if self.fixed:
            low[0] = high[0] = 0.0
        if turns_only:
            low[:, shifts] = high[:, shifts] = 0.0
        return program.solved(low, high, self._joint_limits(way, program.D, low, high))

    def _joint_limits(self, way: Followed, D: Array, low: Array, high: Array) -> Rows:
        """Return the rows of joints near their limits."""
        rows = []
        for side, left in ((1.0, self.limits.upper - way.q), (-1.0, way.q - self.limits.lower)):
            station, joint = np.nonzero(left < _NEAR_LIMIT)
            slope = side * D[station, joint]
            # no more room is asked for than half of a step can make
            inwards = np.maximum(-slope * low[station], -slope * high[station]).sum(axis=1)
            rows.append((station, slope, np.maximum(left[station, joint] - _JOINT_ROOM, -0.5 * inwards)))
        station, slope, room = (np.concatenate(some) for some in zip(*rows, strict=True))
        return Rows(station, slope, np.zeros_like(slope), room)

    def _tilts(self, way: Followed) -> Rows:
        """Return the rows of the disc of tilts."""
        swing = way.coordinates[:, 3:5]
        size = np.sqrt((swing**2).sum(axis=1))
        outer = np.flatnonzero(size > 0.5 * self.tilt)
        outwards = np.zeros((len(outer), len(self.columns)))
        for k, column in enumerate((3, 4)):
            outwards[:, self.columns.index(column)] = swing[outer, k] / size[outer]
        room = np.maximum((1.0 - _ROOM) * self.tilt - size[outer], 0.0)
        return Rows(outer, outwards, np.zeros_like(outwards), room)
