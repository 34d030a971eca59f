"""Timing of joint paths under velocity and acceleration limits, from rest to rest.

A straight piece in joint space has constant limits along it, so its fastest timing is a trapezoid, exact and
without iteration. Any other path is timed by TOPP-RA (H. Pham, Q.-C. Pham, "A new approach to time-optimal path
parameterization based on reachability analysis", IEEE T-RO 2018; library toppra) on at least 200 intervals.

toppra gives nothing or exceeds limits between its grid points now and then, so its answer is measured on a grid
five times as dense, inside every interval on both sides of each grid point. What exceeds is stretched in time by
just that much. If toppra gives nothing, a trapezoid along the path takes its place, slow enough for the path's
sharpest place everywhere; `Trajectory.method` says which it was.
"""

from __future__ import annotations

import logging
import warnings
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.se3 import Array, frozen
from arm.unit import Limits
from plan.line import JointPath
from plan.paths import Path, blended, polyline, smooth_path

CORNERS = ("blend", "stop")
GRID = 200  # fewer lose motion time: 100 intervals cost 2 %
_BEND_GRID = 24  # intervals in a bend, however short
_INSIDE = np.array([1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6])  # of an interval, where limits are measured
_SWITCH = 0.2  # of the acceleration limit: a jump this large is a place to start a new segment


@dataclass(frozen=True)
class State:
    """Positions (m, n) rad, velocities rad/s and accelerations rad/s^2 at m times."""

    q: Array
    qd: Array
    qdd: Array


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A timed path: s moves along it with constant acceleration between knots.

    Attributes:
        path: geometry, see `plan.paths`.
        times, s, rate: (k,) knots: time s, path parameter, and its rate per s.
        limits: that it was timed under.
        method: ``trapezoid``, ``toppra`` or ``fallback``.
        rate_cap: cap on the rate that it was timed under, or None.
        stretch: by which time was lengthened after timing, to keep limits; 1 if it was not.
    """

    path: Path
    times: Array
    s: Array
    rate: Array
    limits: Limits
    method: str
    rate_cap: float | None = None
    stretch: float = 1.0

    @property
    def duration(self) -> float:
        """s."""
        return float(self.times[-1])

    def at(self, times: npt.ArrayLike) -> State:
        """State at times (m,) in s, clamped to the motion."""
        t = np.clip(np.atleast_1d(np.asarray(times, dtype=float)), 0.0, self.times[-1])
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        tau = t - self.times[i]
        drive = self._drive()[i]
        s = np.clip(self.s[i] + tau * (self.rate[i] + 0.5 * drive * tau), self.s[i], self.s[i + 1])
        rate = np.maximum(self.rate[i] + drive * tau, 0.0)[:, None]
        first, second = self.path(s, 1), self.path(s, 2)
        return State(self.path(s), first * rate, second * rate**2 + first * drive[:, None])

    def stretched(self, factor: float) -> Trajectory:
        """The same path in `factor` times the time."""
        return replace(
            self,
            times=frozen(self.times * factor),
            rate=frozen(self.rate / factor),
            stretch=self.stretch * factor,
        )

    def under(self, limits: Limits) -> Trajectory:
        """The same path timed anew under other limits, by the same method."""
        if self.method == "trapezoid":
            return _trapezoids(self.path, limits)
        return time_curve(self.path, limits, self.rate_cap)

    def switches(self) -> Array:
        """Times (k,) in s at which the acceleration jumps by a fifth of a joint's limit or more; without both ends."""
        drive = self._drive()
        gap = np.diff(self.s)
        before = self._acceleration(self.s[1:-1] - 1e-9 * gap[:-1], self.rate[1:-1], drive[:-1])
        after = self._acceleration(self.s[1:-1] + 1e-9 * gap[1:], self.rate[1:-1], drive[1:])
        jumps = (np.abs(after - before) / self.limits.acceleration).max(axis=-1, initial=0.0) > _SWITCH
        return np.asarray(self.times[1:-1][jumps])

    def peaks(self) -> Peaks:
        """Largest velocity and acceleration over their limits, measured inside every interval between knots."""
        s = self.s[:-1, None] + _INSIDE * np.diff(self.s)[:, None]
        drive = self._drive()[:, None]
        rate = np.sqrt(np.maximum(self.rate[:-1, None] ** 2 + 2 * drive * (s - self.s[:-1, None]), 0.0))
        qd = self.path(s, 1) * rate[..., None]
        qdd = self._acceleration(s, rate, np.broadcast_to(drive, s.shape))
        return Peaks(
            float((np.abs(qd) / self.limits.velocity).max()),
            float((np.abs(qdd) / self.limits.acceleration).max()),
        )

    def _drive(self) -> Array:
        """Second derivative of s by time in every interval (k - 1,)."""
        return np.asarray(np.diff(self.rate**2) / (2 * np.diff(self.s)))

    def _acceleration(self, s: Array, rate: Array, drive: Array) -> Array:
        return np.asarray(self.path(s, 2) * rate[..., None] ** 2 + self.path(s, 1) * drive[..., None])


@dataclass(frozen=True)
class Peaks:
    """Largest ratio of a joint's velocity and acceleration to its limit; 1 is on the limit."""

    velocity: float
    acceleration: float

    def stretch(self) -> float:
        """The factor on time that brings both to at most 1."""
        return max(1.0, self.velocity, float(np.sqrt(self.acceleration)))


def time_path(q: npt.ArrayLike, limits: Limits, corners: str = "blend", blend: float = 0.02) -> Trajectory:
    """Fastest motion through straight pieces of joint space, from rest to rest.

    Args:
        q: way-points (n, 6) rad, n >= 2.
        limits: of velocity and acceleration.
        corners: ``stop`` at each, on the path exactly; or ``blend``: go round each, at most `blend` off it.
        blend: rad, Euclidean in joint space.

    Raises:
        InputError: fewer than two different way-points, or an unknown `corners`.
    """
    if corners not in CORNERS:
        raise InputError(f"corners = {corners!r}: must be one of {', '.join(CORNERS)}", corners=corners)
    straight = polyline(q)
    if corners == "stop" or len(straight.x) == 2:
        return _trapezoids(straight, limits)
    return time_curve(blended(q, blend), limits)


def time_line(path: JointPath, limits: Limits, tool_speed: float | None = None) -> Trajectory:
    """Fastest motion along a followed line, from rest to rest.

    Args:
        path: from `plan.line.follow_line`.
        limits: of velocity and acceleration.
        tool_speed: cap on the tool's speed, m/s (rad/s if the line is a turn on the spot), or None.
    """
    return time_curve(smooth_path(path.q, path.s), limits, tool_speed)


def time_curve(path: Path, limits: Limits, rate_cap: float | None = None) -> Trajectory:
    """Fastest motion along any path of `plan.paths`, from rest to rest, by TOPP-RA (see the module for its fallback).

    Args:
        path: with continuous first derivative.
        limits: of velocity and acceleration.
        rate_cap: cap on the path parameter's rate, its unit per s, or None.
    """
    if rate_cap is not None and not rate_cap > 0.0:
        raise InputError(f"speed cap = {rate_cap:g}: must be positive", value=rate_cap)
    grid = _grid(path)
    rate = _toppra_rates(path, grid, limits, rate_cap)
    trajectory = (
        _slow_trapezoid(path, grid, limits, rate_cap)
        if rate is None
        else Trajectory(path, _times(grid, rate), frozen(grid), frozen(rate), limits, "toppra", rate_cap)
    )
    excess = trajectory.peaks().stretch()
    return trajectory if excess <= 1.0 + 1e-12 else trajectory.stretched(excess * (1.0 + 1e-12))


def _grid(path: Path) -> Array:
    """At least `GRID` intervals, several in every bend, none across a jump of the path's second derivative.

    toppra takes the derivative at a grid point for both intervals that meet there. So a point stands a little before
    and one a little after each break, and the short interval between them is held by both sides.
    """
    step = (path.x[-1] - path.x[0]) / GRID
    ends = 2 * path.c[-3, 1:] if path.c.shape[0] > 2 else np.zeros((len(path.x) - 2, path.c.shape[2]))
    jump = np.abs(path(path.x[1:-1] - 1e-9 * step, 2) - ends).max(axis=-1, initial=0.0)
    broken = np.concatenate([[False], jump > 1e-4 * np.abs(ends).max(initial=1e-12), [False]])
    pieces = []
    for i, (a, b) in enumerate(zip(path.x[:-1], path.x[1:], strict=True)):
        bent = broken[i : i + 2].any() and np.abs(path.c[:-2, i]).max(initial=0.0) > 0.0
        count = max(_BEND_GRID if bent else 1, int(np.ceil((b - a) / step - 1e-9)))
        gap = 1e-3 * (b - a) / count
        begin, end = a + gap * broken[i], b - gap * broken[i + 1]
        points = np.linspace(begin, end, count + 1)
        pieces.append(points if broken[i + 1] or i + 2 == len(path.x) else points[:-1])
    return np.concatenate(pieces)


def _times(s: Array, rate: Array) -> Array:
    return frozen(np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / (rate[:-1] + rate[1:]))]))


def _toppra_rates(path: Path, grid: Array, limits: Limits, rate_cap: float | None) -> Array | None:
    """Rates of s on the grid, or None where toppra finds none that can be used."""
    # 2 s to import (it brings matplotlib): only who times a curve waits for it
    with warnings.catch_warnings():
        # where its bytecode is not cached yet (python -O), an escape in a docstring of toppra's warns
        for category in (DeprecationWarning, SyntaxWarning):  # Python 3.11 and from 3.12 on
            warnings.simplefilter("ignore", category)
        import toppra
        import toppra.algorithm as algorithm
        import toppra.constraint as constraint

    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    # toppra works with absolute tolerances: give it a parameter whose rate is near 1 per s
    with np.errstate(divide="ignore"):
        fastest = float((limits.velocity / np.abs(path(grid, 1)).max(axis=0)).min())
    unit = min(fastest, rate_cap) if rate_cap is not None else fastest
    caps = np.column_stack([-limits.velocity, limits.velocity])
    pushes = np.column_stack([-limits.acceleration, limits.acceleration])
    if rate_cap is not None:
        caps = np.vstack([caps, [-rate_cap, rate_cap]])
        pushes = np.vstack([pushes, [-1e3 * rate_cap, 1e3 * rate_cap]])
    geometry = _ToppraPath(path, unit, rate_cap is not None)
    try:
        instance = algorithm.TOPPRA(
            [
                constraint.JointVelocityConstraint(caps),
                constraint.JointAccelerationConstraint(
                    pushes, discretization_scheme=constraint.DiscretizationType.Interpolation
                ),
            ],
            geometry,
            gridpoints=grid / unit,
            solver_wrapper="seidel",
        )
        _, rates, _ = instance.compute_parameterization(0.0, 0.0)
    except (ValueError, ArithmeticError, IndexError, toppra.exceptions.ToppraError):
        return None
    if rates is None or not np.isfinite(rates).all() or (rates[1:-1] <= 0.0).any():
        return None
    rate = np.asarray(rates, dtype=float) * unit
    rate[0] = rate[-1] = 0.0
    return rate


class _ToppraPath:
    """What toppra asks of a path; s in its own unit, and s itself as one more coordinate if its rate is capped."""

    waypoints = None

    def __init__(self, path: Path, unit: float, with_s: bool) -> None:
        self._path, self._unit, self._with_s = path, unit, with_s
        self.dof = path.c.shape[2] + with_s
        self.path_interval = np.array([path.x[0], path.x[-1]]) / unit

    def __call__(self, s: npt.ArrayLike, order: int = 0) -> Array:
        s = np.asarray(s, dtype=float) * self._unit
        value = self._path(s, order) * self._unit**order
        if not self._with_s:
            return np.asarray(value)
        extra = (s, np.full_like(s, self._unit), np.zeros_like(s))[order]
        return np.concatenate([value, extra[..., None]], axis=-1)

    def eval(self, s: npt.ArrayLike) -> Array:
        return self(s, 0)

    def evald(self, s: npt.ArrayLike) -> Array:
        return self(s, 1)

    def evaldd(self, s: npt.ArrayLike) -> Array:
        return self(s, 2)


def _trapezoids(path: Path, limits: Limits) -> Trajectory:
    """A trapezoid for every straight piece; at rest between them."""
    times, s, rate = [0.0], [float(path.x[0])], [0.0]
    for begin, end, slope in zip(path.x[:-1], path.x[1:], np.abs(path.c[0]), strict=True):
        with np.errstate(divide="ignore"):
            top, push = float((limits.velocity / slope).min()), float((limits.acceleration / slope).min())
        _append_trapezoid(times, s, rate, float(begin), float(end), top, push)
    return Trajectory(path, frozen(times), frozen(s), frozen(rate), limits, "trapezoid")


def _append_trapezoid(
    times: list[float], s: list[float], rate: list[float], begin: float, end: float, top: float, push: float
) -> None:
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


def _slow_trapezoid(path: Path, grid: Array, limits: Limits, rate_cap: float | None) -> Trajectory:
    """One trapezoid along the whole path: half of each acceleration limit for the path's bends, half for the ramps."""
    s = (grid[:-1, None] + _INSIDE * np.diff(grid)[:, None]).ravel()
    slope, bend = np.abs(path(s, 1)).max(axis=0), np.abs(path(s, 2)).max(axis=0)
    with np.errstate(divide="ignore"):
        top = min(
            float((limits.velocity / slope).min()), float(np.sqrt((0.5 * limits.acceleration / bend).min()))
        )
        push = float((0.5 * limits.acceleration / slope).min())
    top = min(top, rate_cap) if rate_cap is not None else top
    times, knots, rate = [0.0], [float(grid[0])], [0.0]
    _append_trapezoid(times, knots, rate, float(grid[0]), float(grid[-1]), top, push)
    return Trajectory(path, frozen(times), frozen(knots), frozen(rate), limits, "fallback", rate_cap)
