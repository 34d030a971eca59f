"""Smoothing of a chain along a curve: sequential quadratic programs over the free directions of all stations.

The variables are changes of the free coordinates at every station. The tool stays on the curve, since the joints follow
from the coordinates. Each program minimises, for the joint motions d_i from station to station,

    sum over i, joints k of  w_ik (d_ik / velocity_k)^2  +  b ((d_ik - d_jk) / velocity_k)^2,  with j = i - 1,

subject to the limits of the coordinates and of the joints, a trust region, and linearised distances of all near pairs.
The weights w are those of iteratively reweighted least squares for a norm of high order over the joints, because the
slowest joint alone decides the time of a step (E. Candès, M. Wakin, S. Boyd, "Enhancing sparsity by reweighted l1
minimization", 2008, for the method). With the clearance as the aim, the least distance is a variable, and is maximised.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import qpsolvers
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits
from arm.numerics.products import mul, solve_positive
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.budget import QP_CHECKS, spend
from plan.collision.world import World
from plan.curve.tool_curve import ToolCurve, directions
from plan.kinematics.numeric_ik import solutions_near
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.trajectory.time_estimates import path_time

_ORDER = 3  # of the norm over the joints
_BEND = 4.0  # weight of changes of motion from step to step
_ROOM = 0.15  # of a coordinate's limits at either end, for what lies between stations
_SMALL = 1e-5  # curvature of every variable, relative to the largest
_TURN, _SHIFT = 0.25, 0.006  # rad and m, first trust region
_LEAST_REGION = 0.02  # of the first trust region
_PARTS = (1.0, 0.5)  # of a step that are tried
_INFLUENCE = 0.015  # m beyond the clearance, of pairs that constrain a step
_AIM = 3e-4  # m, added to the clearance where distances are linearised
_PENALTY = 100.0  # per mm of missing clearance, relative to the largest curvature
_MM = 1e-3  # m; clearances of the quadratic program are in mm
_NEAR_LIMIT = 0.3  # rad from a joint limit that constrains a step
_JOINT_ROOM = 1e-3  # rad (m) kept to joint limits: for a step's curvature and what is between stations
_PROBE = 1e-6  # rad or m, of the derivative by the coordinates
_WORTH = 2e-3  # least useful gain of a step, relative
_WORTH_M = 5e-5  # m, least useful gain of distance
_WIDENING = 1e-2  # weight of time against 1 per mm of distance, if distance is the aim
_FARTHEST = 0.04  # m, distances beyond which more is no gain


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
class Demand:
    """A clearance that all pairs of a world have to keep, m."""

    world: World
    clearance: float

    def met(self, q: Array) -> bool:
        """Return whether configurations (m, n) keep it."""
        return not any(map(self.world.too_near(self.clearance), q))

    def least(self, q: Array) -> float:
        """Return the least distance at configurations (m, n), m, at most `_FARTHEST`."""
        return min((float(d) for d in self.world.near(q, _FARTHEST).distance), default=_FARTHEST)


class Smoothing:
    """Smooths the way of the joints along one curve.

    Args:
        robot: the arm.
        curve: what the tool follows.
        demands: clearances to keep.
        limits: of the joints.
        fixed: whether the first station stays as it is.
    """

    def __init__(
        self,
        robot: Robot,
        curve: ToolCurve,
        demands: Sequence[Demand],
        limits: Limits,
        fixed: bool = False,
    ) -> None:
        self.fixed = fixed
        self.robot, self.curve, self.demands, self.limits = robot, curve, tuple(demands), limits
        self.arm = product_of_exponentials(robot)
        self.columns = directions(curve)
        low, high = (some[self.columns] for some in curve.box())
        room = np.where(np.isinf(high), 0.0, _ROOM * (high - low))
        self.low, self.high, self.room, self.tilt = low, high, room, curve.freedom.tilt

    def at(self, places: Array, coordinates: Array, q: Array) -> Followed | None:
        """Return configurations near q (m, n) with these coordinates; None if there are none within limits."""
        T = self.curve.placed(places, coordinates)
        found, met = solutions_near(self.robot, q, T, self.limits.lower, self.limits.upper)
        if not met.all() or np.abs(found - q).max() > 0.5:
            return None
        return Followed(frozen(places), frozen(coordinates), frozen(found))

    def finer(self, way: Followed) -> Followed | None:
        """Return the way with a station in the middle of every step; coordinates follow the spline through theirs."""
        middles = 0.5 * (way.places[1:] + way.places[:-1])
        between = CubicSpline(way.places, way.coordinates)(middles)
        self._within(between)
        q = CubicSpline(way.places, way.q)(middles)
        coordinates = _merged(way.coordinates, between)
        return self.at(_merged(way.places, middles), coordinates, _merged(way.q, q))

    def _within(self, coordinates: Array) -> None:
        """Move coordinates (m, 6) into their limits, in place."""
        coordinates[:, self.columns] = np.clip(coordinates[:, self.columns], self.low, self.high)
        tilt = self.tilt
        if tilt > 0.0:
            swing = np.sqrt((coordinates[:, 3:5] ** 2).sum(axis=1, keepdims=True))
            coordinates[:, 3:5] *= np.minimum(1.0, tilt / np.maximum(swing, 1e-12))

    def blocked(self, way: Followed) -> bool:
        """Return whether a station, or the middle between two, is too near to something."""
        return not all(demand.met(way.all_q) for demand in self.demands)

    def time(self, way: Followed) -> float:
        """Estimate the time of a way, s."""
        return path_time(way.q, self.limits)

    def smoothed(self, way: Followed, rounds: int, turns_only: bool = False) -> Followed:
        """Return a faster way that is clear at its stations; the same if none is found.

        With `turns_only` free positions stay as they are.
        """
        if not self.columns:
            return way
        return self._better(
            way,
            rounds,
            lambda at, region: self._step(at, region, turns_only=turns_only),
            lambda at: -self.time(at),
            lambda value: _WORTH * -value,
        )

    def widened(self, way: Followed, rounds: int, of: Demand) -> Followed:
        """Return a way with more distance between the pairs of a demand, which also keeps all others."""
        if not self.columns:
            return way
        return self._better(
            way,
            rounds,
            lambda at, region: self._step(at, region, of),
            lambda at: of.least(at.all_q),
            lambda value: _WORTH_M,
        )

    def _better(
        self,
        way: Followed,
        rounds: int,
        step_at: Callable[[Followed, float], Array | None],
        value_of: Callable[[Followed], float],
        worth: Callable[[float], float],
    ) -> Followed:
        """Return a way of larger value that is clear at its stations; the same if none is found.

        Args:
            way: where to begin.
            rounds: largest number of quadratic programs.
            step_at: their solution at a way, within a trust region.
            value_of: what is maximised.
            worth: least useful gain at a value.
        """
        value, region = value_of(way), 1.0
        for _ in range(rounds):
            if region < _LEAST_REGION:
                break
            spend(QP_CHECKS)
            step = step_at(way, region)
            if step is None:
                break
            for part in _PARTS:
                trial = self._moved(way, part * step)
                if trial is None:
                    continue
                more = value_of(trial) - value
                if more > worth(value) and not self.blocked(trial):
                    way, value = trial, value + more
                    region = min(1.0, 1.5 * part * region)
                    break
            else:
                region *= 0.3
        return way

    def _moved(self, way: Followed, step: Array) -> Followed | None:
        coordinates = np.array(way.coordinates)
        coordinates[:, self.columns] += step
        self._within(coordinates)
        guess = way.q + mul(self._derivatives(way), step[..., None])[..., 0]
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

    def _step(
        self, way: Followed, region: float, widened: Demand | None = None, turns_only: bool = False
    ) -> Array | None:
        """Return the best change (m, f) of the free coordinates within a trust region; None if there is none.

        It is the fastest; or, with a demand that is `widened`, the one with the largest least distance of its pairs.
        """
        D, (m, f) = self._derivatives(way), (len(way.q), len(self.columns))
        size = m * f + 2  # the missing clearance, and the least distance of what is widened
        P, linear = np.zeros((m, f, m, f)), np.zeros((m, f))
        v = self.limits.velocity
        steps = np.diff(way.q, axis=0) / v
        W = _weights(steps)
        S = D / v[:, None]
        for weight, parts in (
            (W, (-1.0, 1.0)),
            (np.full((m - 2, len(v)), _BEND * float(W.mean())), (1.0, -2.0, 1.0)),
        ):
            rows = len(parts)
            value = steps if rows == 2 else np.diff(steps, axis=0)
            for a, one in enumerate(parts):
                here = np.arange(a, a + len(value))
                of_a = one * S[here] * weight[..., None]
                np.add.at(linear, here, (of_a * value[..., None]).sum(axis=1))
                for b, two in enumerate(parts):
                    there = np.arange(b, b + len(value))
                    block = mul(np.swapaxes(of_a, 1, 2), two * S[there])
                    P[here, :, there, :] += block
        matrix = np.zeros((size, size))
        matrix[:-2, :-2] = P.reshape(m * f, m * f)
        largest = max(float(np.abs(matrix).max()), 1e-12)
        matrix, linear = matrix / largest, linear / largest
        if widened is not None:
            matrix, linear = _WIDENING * matrix, _WIDENING * linear
        matrix[range(size), range(size)] += _SMALL
        matrix[-2, -2] = matrix[-1, -1] = 1e-2
        trust = region * np.where(np.array(self.columns) < 3, _SHIFT, _TURN)
        at = way.coordinates[:, self.columns]
        low = np.maximum(np.minimum(self.low + self.room - at, 0.0), -trust)
        high = np.minimum(np.maximum(self.high - self.room - at, 0.0), trust)
        if self.fixed:
            low[0] = high[0] = 0.0
        if turns_only:
            shifts = np.array(self.columns) < 3
            low[:, shifts] = high[:, shifts] = 0.0
        G, h = self._rows(way, D, size, widened, low, high)
        x = qpsolvers.solve_qp(
            matrix,
            np.concatenate([linear.ravel(), [_PENALTY, 0.0 if widened is None else -1.0]]),
            G,
            h,
            lb=np.concatenate([low.ravel(), [0.0, -1e3]]),
            ub=np.concatenate([high.ravel(), [1e3, 1e3]]),
            solver="daqp",
        )
        return None if x is None else x[:-2].reshape(m, f)

    def _rows(
        self, way: Followed, D: Array, size: int, widened: Demand | None, low: Array, high: Array
    ) -> tuple[Array, Array]:
        """Return the rows G x <= h: distances, joint limits and the disc of tilts, for changes (m, f) within bounds."""
        f = len(self.columns)
        rows, room = [], []
        for demand in self.demands:
            some, distance = self._distances(way, D, size, demand.world, demand.clearance + _INFLUENCE)
            some[:, -2] = -_MM
            rows.append(some)
            room.append(distance - (demand.clearance + _AIM))
        if widened is not None:
            some, distance = self._distances(way, D, size, widened.world, _FARTHEST)
            some[:, -1] = _MM
            rows.append(some)
            room.append(distance)
        for side, left in ((1.0, self.limits.upper - way.q), (-1.0, way.q - self.limits.lower)):
            station, joint = np.nonzero(left < _NEAR_LIMIT)
            some = np.zeros((len(station), size))
            place = station[:, None] * f + np.arange(f)
            slope = side * D[station, joint]
            some[np.arange(len(station))[:, None], place] = slope
            rows.append(some)
            # no more room is asked for than half of a step can make
            inwards = np.maximum(-slope * low[station], -slope * high[station]).sum(axis=1)
            room.append(np.maximum(left[station, joint] - _JOINT_ROOM, -0.5 * inwards))
        tilt = self.tilt
        if tilt > 0.0:
            swing = way.coordinates[:, 3:5]
            size_of = np.sqrt((swing**2).sum(axis=1))
            outer = np.flatnonzero(size_of > 0.5 * tilt)
            some = np.zeros((len(outer), size))
            for k, column in enumerate((3, 4)):
                some[np.arange(len(outer)), outer * f + self.columns.index(column)] = (
                    swing[outer, k] / size_of[outer]
                )
            rows.append(some)
            room.append(np.maximum((1.0 - _ROOM) * tilt - size_of[outer], 0.0))
        return np.concatenate(rows), np.concatenate(room)

    def _distances(
        self, way: Followed, D: Array, size: int, world: World, near: float
    ) -> tuple[Array, Array]:
        """Return rows (k, size) of the pairs nearer than `near` m at stations and middles, and their distances (k,)."""
        m, f = len(way.q), len(self.columns)
        found = world.near(way.all_q, near)
        pushed = np.zeros((len(found.row), m, f))
        index = np.arange(len(found.row))
        inner = found.row >= m
        first = np.where(inner, found.row - m, found.row)
        part = np.where(inner, 0.5, 1.0)[:, None]
        pushed[index, first] -= part * mul(found.gradient[:, None], D[first])[:, 0]
        second = first[inner] + 1
        pushed[index[inner], second] -= 0.5 * mul(found.gradient[inner, None], D[second])[:, 0]
        rows = np.zeros((len(index), size))
        rows[:, : m * f] = pushed.reshape(len(index), m * f)
        return rows, found.distance


def _weights(steps: Array) -> Array:
    """Return the weights (m, n) of steps (m, n), s, whose weighted squares stand for a norm of high order."""
    size = np.abs(steps) + 1e-4
    largest = size.max(axis=1, keepdims=True)
    ratio = size / largest
    whole = (ratio**_ORDER).sum(axis=1, keepdims=True) ** (1.0 / _ORDER)
    return np.asarray(ratio ** (_ORDER - 2) / (whole ** (_ORDER - 1) * largest))


def _merged(values: Array, middles: Array) -> Array:
    """Return values (m, ...) with middles (m - 1, ...) between them."""
    out = np.empty((2 * len(values) - 1, *values.shape[1:]))
    out[::2], out[1::2] = values, middles
    return out
