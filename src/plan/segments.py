"""From a timed motion to what the controller executes: integer cubics, one ``COORDSPLINET`` each.

Every segment is the cubic with the planned positions and velocities at both ends (Hermite). In counts, with D the
displacement, v0 and v1 the end velocities and T the duration, a1 = v0 T, a2 = 3 D - 2 v0 T - v1 T and
a3 = v0 T + v1 T - 2 D. Only D, v0 T and v1 T are rounded: then all coefficients are integers and sum to D exactly,
so the end of a chain of segments is known to the count.

Segments begin where the acceleration switches, else every ~100 ms, and are halved where the executed curve would
leave the planned one. Rounding adds up to a few counts/T^2 to the acceleration, which matters for slow motions:
those take longer segments. If a limit is still exceeded, the path is timed anew with that limit a little lower.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from arm.errors import ImpossibleError, InputError
from arm.motion import CountPath, Segment
from arm.robot import Robot
from arm.se3 import Array, frozen
from arm.unit import Counts, Limits, Unit
from plan.extremes import cubic_acceleration, cubic_speed
from plan.line import Line
from plan.screws import screw_arm
from plan.timing import Trajectory

SHORTEST_MS = 40  # the serial line sends about 25 cubics a second (fact sheet of the controller, section 3)
_LONGER = (
    1.5,
    2.0,
    3.0,
    4.0,
    6.0,
    8.0,
    12.0,
    16.0,
)  # times the asked duration, tried where rounding weighs too much
_ROUNDING = 8.0  # counts/T^2, about what rounding D, v0 T and v1 T adds to an acceleration at the worst
_ROUNDS = 12  # of slowing down before giving up
_SAMPLES = np.arange(1, 8) / 8.0  # of a segment, where it is compared with the plan


@dataclass(frozen=True)
class LineTolerance:
    """Keeps the executed tool on a line.

    Attributes:
        robot: whose tool.
        line: the line.
        distance, angle: largest deviation from it, m and rad.
    """

    robot: Robot
    line: Line
    distance: float = 5e-5
    angle: float = 5.2e-4


def to_segments(
    trajectory: Trajectory,
    unit: Unit,
    segment_ms: int = 100,
    *,
    limits: Limits | None = None,
    deviation: float = 2e-4,
    line: LineTolerance | None = None,
) -> CountPath:
    """Integer cubic segments of a motion from rest to rest.

    Args:
        trajectory: what was planned.
        unit: whose counts.
        segment_ms: duration that segments have where nothing asks for less.
        limits: that the segments must keep, exactly and everywhere; default: those the trajectory was timed under.
            Give the registers' limits to leave the planned fractions as room for rounding.
        deviation: of any joint from the planned motion at the same time, rad; also 1 count is always allowed.
        line: tolerance of the tool on its line, or None.

    Returns:
        a chain that starts at rest at ``unit.counts`` of the first configuration and ends so at the last.

    Raises:
        InputError: `segment_ms` is below `SHORTEST_MS`.
        ImpossibleError: limits so small that rounding to counts alone exceeds them; data: axis.
    """
    if segment_ms < SHORTEST_MS:
        raise InputError(f"segment_ms = {segment_ms}: must be at least {SHORTEST_MS}", segment_ms=segment_ms)
    fitter = _Fitter(unit, limits or trajectory.limits, deviation, line)
    if fitter.calm_ms(1.0) > segment_ms * _LONGER[-1]:
        raise _too_slow(unit, int(np.argmin(fitter.acceleration())))
    for _ in range(_ROUNDS):
        total = max(2 * SHORTEST_MS, int(np.ceil(trajectory.duration * 1e3 - 1e-6)))
        timed = trajectory.stretched(total / 1e3 / trajectory.duration)
        fit = fitter.best(timed, total, segment_ms)
        if fit.excess() <= 1.0:
            return fit.path(unit.counts(timed.at([0.0]).q[0]))
        trajectory = _slower(trajectory, fit)
    raise _too_slow(unit, int(np.argmax(fit.load().max(axis=0))))


def _too_slow(unit: Unit, joint: int) -> ImpossibleError:
    return ImpossibleError(
        f"axis {unit.axes[joint]} exceeds its limits when the motion is rounded to counts, however slow; "
        "raise the speed factor or the acceleration registers",
        axis=unit.axes[joint],
    )


def _slower(trajectory: Trajectory, fit: _Fit) -> Trajectory:
    """The path timed anew, with the limits that its segments exceed lowered by what they exceed."""
    velocity = np.maximum(1.0, fit.velocity.max(axis=0) * 1.001)
    acceleration = np.maximum(1.0, fit.acceleration.max(axis=0) * 1.01)
    limits = trajectory.limits
    return trajectory.under(
        replace(
            limits,
            velocity=frozen(limits.velocity / np.where(velocity > 1.001, velocity, 1.0)),
            acceleration=frozen(limits.acceleration / np.where(acceleration > 1.01, acceleration, 1.0)),
        )
    )


@dataclass(frozen=True, eq=False)
class _Fit:
    """Segments of one choice of knots.

    Attributes:
        knots_ms: (k + 1,) int.
        coefficients: (3, k, n) int.
        velocity, acceleration: (k, n) largest over their limits.
        off: (k,) deviation over what is allowed.
    """

    knots_ms: Counts
    coefficients: Counts
    velocity: Array
    acceleration: Array
    off: Array

    def load(self) -> Array:
        return np.maximum(self.velocity, self.acceleration)

    def excess(self) -> float:
        return float(self.load().max())

    def path(self, start: Counts) -> CountPath:
        rows = np.moveaxis(self.coefficients, 1, 0).tolist()
        return CountPath(
            tuple(int(c) for c in start),
            tuple(
                Segment(int(ms), tuple(tuple(row) for row in a))
                for ms, a in zip(np.diff(self.knots_ms), rows, strict=True)
            ),
        )


@dataclass(frozen=True, eq=False)
class _Fitter:
    unit: Unit
    limits: Limits
    deviation: float
    line: LineTolerance | None

    def best(self, timed: Trajectory, total_ms: int, segment_ms: int) -> _Fit:
        """Segments of the asked duration if they keep the limits, else longer ones that suffer less from rounding."""
        found = self.fit(timed, total_ms, segment_ms)
        for factor in _LONGER:
            if found.excess() <= 1.0 or segment_ms * factor > self.calm_ms(0.005):
                break
            longer = self.fit(timed, total_ms, int(segment_ms * factor))
            if longer.excess() < found.excess():
                found = longer
        return found

    def fit(self, timed: Trajectory, total_ms: int, segment_ms: int) -> _Fit:
        """Halve segments that are off the plan or over a limit, while they may be halved."""
        calm = max(SHORTEST_MS, self.calm_ms(0.25))
        knots = _first_knots(timed, total_ms, segment_ms, min(calm, segment_ms))
        while True:
            fit = self._measured(timed, knots)
            length = np.diff(knots)
            # where a limit is exceeded, halving helps only while rounding weighs little in the halves
            split = (fit.off > 1.0) & (length >= 2 * SHORTEST_MS)
            split |= (fit.load().max(axis=1) > 1.0) & (length >= 2 * calm)
            if not split.any():
                return fit
            knots = np.sort(np.concatenate([knots, knots[:-1][split] + length[split] // 2]))

    def calm_ms(self, share: float) -> float:
        """Duration from which on rounding adds at most this share of any acceleration limit."""
        return float(1e3 * np.sqrt(_ROUNDING / (share * self.acceleration().min())))

    def acceleration(self) -> Array:
        return np.asarray(self.limits.acceleration * np.abs(self.unit.counts_per_rad))

    def _measured(self, timed: Trajectory, knots: Counts) -> _Fit:
        unit = self.unit
        duration = np.diff(knots)[:, None] / 1e3
        ends = timed.at(knots / 1e3)
        counts = unit.counts(ends.q)
        speed = ends.qd * unit.counts_per_rad
        D = np.diff(counts, axis=0)
        v0 = np.rint(speed[:-1] * duration).astype(np.int64)
        v1 = np.rint(speed[1:] * duration).astype(np.int64)
        a = np.stack([v0, 3 * D - 2 * v0 - v1, v0 + v1 - 2 * D])

        scale = np.abs(unit.counts_per_rad)
        velocity = cubic_speed(a.astype(float)) / duration / (self.limits.velocity * scale)
        acceleration = cubic_acceleration(a.astype(float)) / duration**2 / self.acceleration()

        u = _SAMPLES[:, None, None]
        executed = counts[:-1] + u * (a[0] + u * (a[1] + u * a[2]))
        times = knots[:-1] / 1e3 + _SAMPLES[:, None] * duration[:, 0]
        planned = (
            unit.counts_at_zero + timed.at(times.ravel()).q.reshape(executed.shape) * unit.counts_per_rad
        )
        off = (np.abs(executed - planned) / (1.0 + self.deviation * scale)).max(axis=(0, 2))
        if self.line is not None:
            poses = screw_arm(self.line.robot).tool_poses(unit.positions(executed).reshape(-1, 6))
            away = self.line.line.deviation(poses)
            worst = np.maximum(away.distance / self.line.distance, away.angle / self.line.angle)
            off = np.maximum(off, worst.reshape(len(_SAMPLES), -1).max(axis=0))
        return _Fit(knots, a, velocity, acceleration, off)


def _first_knots(timed: Trajectory, total_ms: int, segment_ms: int, apart_ms: float) -> Counts:
    """Knots at the acceleration's switches and evenly between them; switches closer than `apart_ms` count as one."""
    stops = [0]
    for switch in np.rint(timed.switches() * 1e3).astype(int):
        if switch - stops[-1] >= apart_ms and total_ms - switch >= apart_ms:
            stops.append(int(switch))
    stops.append(total_ms)
    knots = [0]
    for begin, end in pairwise(stops):
        parts = max(1, int(np.ceil((end - begin) / segment_ms)))
        knots.extend(begin + (end - begin) * i // parts for i in range(1, parts + 1))
    return np.array(knots, dtype=np.int64)
