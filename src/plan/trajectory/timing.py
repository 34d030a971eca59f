"""Time parametrisation of joint paths under velocity and acceleration limits, from rest to rest.

On a straight piece in joint space the limits are constant, so the fastest timing is a trapezoid, exact and without
iteration. Any other path is timed by reachability analysis: ours (`plan.trajectory.topp_ra`), or the library's on
request (`plan.trajectory.toppra_timing`).

On a path of third order, the acceleration can slightly exceed its limit between grid points. So every result is
measured inside every interval. Intervals with a large excess are timed again with a lower limit; a small excess is
removed by stretching the whole trajectory in time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits
from arm.errors import ImpossibleError, InputError
from arm.se3 import Array, frozen
from plan.trajectory.joint_path import Path, polyline
from plan.trajectory.topp_ra import gridpoints, parametrise
from plan.trajectory.toppra_timing import parametrise_by_toppra

Caps = float | Array | None  # on the rate of the path parameter, for a whole path or for each piece of it

GRID = 200  # intervals over all curved pieces, at least; fewer give slower motions
# Intervals of each curved piece of a spline, on average and at least: knots are where the path needs them, and a tight
# corner beside long pieces would have one interval a piece, with which no rate but 0 is found.
PER_PIECE = 4
_TOPPRA_GRID = 400  # intervals over a whole path for the library
_BEND_GRID = 12  # intervals in a bend, however short; in a parabola, limits hold between them too
_INSIDE = np.array([1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6])  # places in an interval where limits are measured
_EASINGS = 4  # largest number of timings of one path
_WORTH_EASING = 1.0005  # excess of an acceleration limit above which intervals are timed again
_ROOM = 1.1  # factor on an excess to remove it
_SWITCH = 0.2  # of the acceleration limit: jumps this large should start a new segment


@dataclass(frozen=True)
class State:
    """Positions (m, n) rad, velocities (m, n) rad/s and accelerations (m, n) rad/s^2 at m times."""

    q: Array
    qd: Array
    qdd: Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A timed path, with constant second derivative of s between knots.

    Attributes:
        path: geometry, see `plan.trajectory.joint_path`.
        times, s, rate: (k,) knots: time in s, path parameter, and its rate per s.
        limits: limits that it was timed under.
        method: ``trapezoid``, ``topp``, ``toppra`` or ``ruckig`` (`plan.trajectory.jerk_limited`).
        rate_cap: cap on the rate that it was timed under, or None.
        stretch: factor on time after timing, to keep the limits; 1 if not needed.
    """

    path: Path
    times: Array
    s: Array
    rate: Array
    limits: Limits
    method: str
    rate_cap: Caps = None
    stretch: float = 1.0

    @property
    def duration(self) -> float:
        """Duration, s."""
        return float(self.times[-1])

    def at(self, times: npt.ArrayLike) -> State:
        """Return the state at times (m,) in s, clamped to the motion."""
        t = np.clip(np.atleast_1d(np.asarray(times, dtype=float)), 0.0, self.times[-1])
        s, rate, drive, *_ = self._scalars(t)
        first, second = self.path(s, 1), self.path(s, 2)
        return State(self.path(s), first * rate, second * rate**2 + first * drive)

    def passed(self, s: npt.ArrayLike) -> Array:
        """Return the times (m,) in s at which the motion passes path parameters s (m,), clamped to the path."""
        places = np.clip(np.atleast_1d(np.asarray(s, dtype=float)), self.s[0], self.s[-1])
        i = np.clip(np.searchsorted(self.s, places, side="right") - 1, 0, len(self.s) - 2)
        past = places - self.s[i]
        rate = np.sqrt(np.maximum(self.rate[i] ** 2 + 2.0 * self._drive()[i] * past, 0.0))
        sum_ = np.maximum(self.rate[i] + rate, 1e-300)
        return np.asarray(np.minimum(self.times[i] + 2.0 * past / sum_, self.times[i + 1]))

    def stretched(self, factor: float) -> Trajectory:
        """Return the same path in `factor` times the time."""
        return replace(
            self,
            times=frozen(self.times * factor),
            rate=frozen(self.rate / factor),
            stretch=self.stretch * factor,
        )

    def under(self, limits: Limits) -> Trajectory:
        """Time the same path under other limits, by the same method."""
        if self.method == "trapezoid":
            return _trapezoids(self.path, limits)
        return time_curve(self.path, limits, self.rate_cap, self.method == "toppra")

    def switches(self) -> Array:
        """Return the times (k,) in s, without both ends, where an acceleration jumps by over 20 % of its limit."""
        drive = self._drive()
        gap = np.diff(self.s)
        before = self._acceleration(self.s[1:-1] - 1e-9 * gap[:-1], self.rate[1:-1], drive[:-1])
        after = self._acceleration(self.s[1:-1] + 1e-9 * gap[1:], self.rate[1:-1], drive[1:])
        jumps = (np.abs(after - before) / self.limits.acceleration).max(axis=-1, initial=0.0) > _SWITCH
        return np.asarray(self.times[1:-1][jumps])

    def loads(self) -> tuple[Array, Array]:
        """Return the largest velocity and acceleration, relative to their limits, between knots; (k - 1,) each.

        Between knots the square of the rate is linear in s. So on a path of order 3 the acceleration is quadratic in s,
        and its extreme follows from three values. The velocity is measured at five places.
        """
        s = self.s[:-1, None] + _INSIDE * np.diff(self.s)[:, None]
        drive = self._drive()[:, None]
        square = np.maximum(self.rate[:-1, None] ** 2 + 2 * drive * (s - self.s[:-1, None]), 0.0)
        slope = self.path(s, 1)
        velocity = np.abs(slope) * np.sqrt(square)[..., None] / self.limits.velocity
        qdd = slope[:, ::2] * drive[..., None] + self.path(s[:, ::2], 2) * square[:, ::2, None]
        first, middle, last = np.moveaxis(qdd / self.limits.acceleration, 1, 0)
        tilt, bend = 4.0 * middle - 3.0 * first - last, 2.0 * (first + last - 2.0 * middle)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.nan_to_num(-tilt / (2.0 * bend), nan=0.0, posinf=0.0, neginf=0.0)
        at = np.clip(at, 0.0, 1.0)
        every = np.abs([first, middle, last, first + at * (tilt + at * bend)])
        return velocity.max(axis=(1, 2)), every.max(axis=(0, 2))

    def _scalars(self, t: Array) -> tuple[Array, ...]:
        """Return s (m,) and its first and second derivative with respect to time, (m, 1) each, at times t (m,)."""
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        tau = t - self.times[i]
        drive = self._drive()[i]
        s = np.clip(self.s[i] + tau * (self.rate[i] + 0.5 * drive * tau), self.s[i], self.s[i + 1])
        return s, np.maximum(self.rate[i] + drive * tau, 0.0)[:, None], drive[:, None]

    def _drive(self) -> Array:
        """Return the second derivative of s with respect to time between knots, (k - 1,)."""
        return np.asarray(np.diff(self.rate**2) / (2 * np.diff(self.s)))

    def _acceleration(self, s: Array, rate: Array, drive: Array) -> Array:
        return np.asarray(self.path(s, 2) * rate[..., None] ** 2 + self.path(s, 1) * drive[..., None])


def time_path(q: npt.ArrayLike, limits: Limits) -> Trajectory:
    """Time the straight joint-space pieces between way-points q (m, n) rad, with a stop at each corner.

    Raises:
        InputError: fewer than two different way-points.
    """
    return _trapezoids(polyline(q), limits)


def time_curve(path: Path, limits: Limits, rate_cap: Caps = None, by_toppra: bool = False) -> Trajectory:
    """Time any path of `plan.trajectory.joint_path`, from rest to rest, by TOPP-RA.

    Args:
        path: path with continuous first derivative.
        limits: limits of velocity and acceleration.
        rate_cap: cap on the rate of the path parameter, its unit per s: one for the path, or one for each piece (inf
            for no cap), or None.
        by_toppra: whether the library toppra solves it, instead of `plan.trajectory.topp_ra`. Its result is corrected
            like ours.

    Raises:
        InputError: a cap is not positive, or no joint moves along the path.
        ImpossibleError: toppra gives no answer, or the times are not finite.
    """
    counts = _counts_of_toppra(path) if by_toppra else _counts(path)
    method, solve = ("toppra", parametrise_by_toppra) if by_toppra else ("topp", parametrise)
    stage = gridpoints(path, counts, rate_caps(path, rate_cap))
    ease = np.ones(len(stage.s) - 1)
    for _ in range(_EASINGS):
        s, rate = solve(stage, limits, ease)
        trajectory = Trajectory(path, _times(s, rate), frozen(s), frozen(rate), limits, method, rate_cap)
        velocity, acceleration = trajectory.loads()
        if acceleration.max() <= _WORTH_EASING:
            break
        which = np.clip(np.searchsorted(stage.s, s[:-1], side="right") - 1, 0, len(ease) - 1)
        np.maximum.at(ease, which, ease[which] * (1.0 + _ROOM * np.maximum(0.0, acceleration - 1.0)))
    if not (np.isfinite(trajectory.times).all() and np.isfinite(acceleration).all()):
        why = f"a path of {len(path.x) - 1} pieces cannot be timed; move its goals apart, or leave some out"
        raise ImpossibleError(why, pieces=len(path.x) - 1)
    # a velocity that is too high at `_INSIDE` may be slightly higher between these places
    velocity = 1.0 + _ROOM * (velocity - 1.0)
    excess = max(1.0, float(velocity.max()), float(np.sqrt(acceleration.max())))
    return trajectory if excess <= 1.0 + 1e-12 else trajectory.stretched(excess * (1.0 + 1e-12))


def rate_caps(path: Path, rate_cap: Caps) -> Array:
    """Return the cap on the rate in each piece of a path, inf for no cap.

    Raises:
        InputError: a cap is not positive.
    """
    caps = np.broadcast_to(np.asarray(np.inf if rate_cap is None else rate_cap, dtype=float), len(path.x) - 1)
    if not (caps > 0.0).all():
        raise InputError(f"speed cap = {caps.min():g}: must be positive", value=float(caps.min()))
    return caps


def _counts(path: Path, per_piece: int = PER_PIECE) -> npt.NDArray[np.int64]:
    """Return the number of intervals of each piece: one if it is straight, which is exact; else several."""
    straight = ~(path.c[:-2] != 0.0).any(axis=(0, 2))
    length = np.diff(path.x)
    is_spline = path.c.shape[0] > 3  # which has many pieces
    grid = max(GRID, per_piece * int(np.count_nonzero(~straight))) if is_spline else GRID
    step = max(float(length[~straight].sum()), 1e-12) / grid
    least = per_piece if is_spline else _BEND_GRID
    return np.where(straight, 1, np.maximum(least, np.ceil(length / step - 1e-9))).astype(np.int64)


def _counts_of_toppra(path: Path) -> npt.NDArray[np.int64]:
    """Return the number of intervals of each piece: it has no switches inside intervals, in straight pieces neither."""
    length = np.diff(path.x)
    step = float(length.sum()) / _TOPPRA_GRID
    return np.asarray(np.maximum(_counts(path, 1), np.ceil(length / step - 1e-9)), dtype=np.int64)


def _times(s: Array, rate: Array) -> Array:
    return frozen(np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / (rate[:-1] + rate[1:]))]))


def _trapezoids(path: Path, limits: Limits) -> Trajectory:
    """Time each straight piece by a trapezoid, with stops between them."""
    times, s, rate = [0.0], [float(path.x[0])], [0.0]
    for begin, end, slope in zip(path.x[:-1].tolist(), path.x[1:].tolist(), np.abs(path.c[0]), strict=True):
        with np.errstate(divide="ignore"):
            top, push = float((limits.velocity / slope).min()), float((limits.acceleration / slope).min())
        length = end - begin
        top = min(top, float(np.sqrt(push * length)))
        ramp = top**2 / (2 * push)
        flat = length - 2 * ramp
        steps = [(ramp, top / push, top)]
        if flat > 1e-12 * length:
            steps.append((flat, flat / top, top))
        for distance, duration, reached in steps:
            times.append(times[-1] + duration)
            s.append(s[-1] + distance)
            rate.append(reached)
        times.append(times[-1] + top / push)
        s.append(end)
        rate.append(0.0)
    return Trajectory(path, frozen(times), frozen(s), frozen(rate), limits, "trapezoid")
