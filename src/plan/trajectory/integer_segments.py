"""Conversion of a trajectory to the integer cubics that the controller executes, one ``COORDSPLINET`` each.

Every segment approximates the Hermite cubic with the planned positions and velocities at both ends. It is rounded so
that limits hold exactly (`plan.trajectory.rounding`). Because coefficients are integers, the end of a chain of segments
is known to the count.

Knots lie where the acceleration switches, and about every 100 ms between switches. A segment is halved if the executed
curve would leave the planned one. If no rounding keeps the limits, the motion is made slightly longer, with longer
segments, in which one count weighs less. If a limit is exceeded even then, the path is timed again with a lower limit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Counts, Limits, Unit
from arm.errors import ImpossibleError, InputError
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.cartesian.line import Line
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.trajectory.extremes import cubic_peaks
from plan.trajectory.rounding import round_chain, vertex_jump
from plan.trajectory.timing import Trajectory

SHORTEST_MS = 40  # the line sends about 25 cubics a second (docs/sources.md, "Capacity of the line")
_LONGEST = 16  # longest segment, in multiples of segment_ms, where rounding errors are too large
_ROUNDING = 8.0  # counts/T^2, about the most that nearest rounding adds to an acceleration
# Factors on the duration, on segment_ms, and on the least distance between knots, in the order of the attempts. The
# first attempt changes nothing; it is for plans that leave room for rounding.
_TRIES = (
    (1.0, 1.0, 1.0),
    (1.0005, 2.0, 1.0),
    (1.001, 1.5, 1.0),
    (1.0015, 2.0, 1.0),
    (1.002, 1.0, 1.0),
    (1.003, 2.0, 2.0),
    (1.005, 1.0, 1.0),
    (1.008, 1.5, 2.0),
    (1.012, 1.0, 1.0),
    (1.02, 2.0, 2.0),
)
_ROUNDS = 12  # slower timings before giving up
_SAMPLES = np.arange(1, 8) / 8.0  # places in a segment where it is compared with the plan


@dataclass(frozen=True)
class LineTolerance:
    """Tolerance of the executed tool motion on a line.

    Attributes:
        robot: the arm.
        line: the line.
        distance, angle: largest deviation from the line, m and rad.
    """

    robot: Robot
    line: Line
    distance: float = 5e-5
    angle: float = 5.2e-4


@dataclass(frozen=True)
class Marked:
    """Segments of a motion with joins at marks.

    Attributes:
        path: the segments.
        first: for each mark, the index of the first segment after it.
    """

    path: CountPath
    first: tuple[int, ...]


class MarksTooNear(InputError):
    """Marks on a motion are closer in time than the shortest segment; data: marks_ms."""


def to_segments(
    trajectory: Trajectory,
    unit: Unit,
    segment_ms: int = 100,
    *,
    limits: Limits | None = None,
    deviation: float = 2e-4,
    line: LineTolerance | None = None,
    jump: Array | None = None,
) -> CountPath:
    """Convert a trajectory from rest to rest to integer cubic segments.

    Args:
        trajectory: planned trajectory.
        unit: unit that defines the counts.
        segment_ms: duration of a segment unless a shorter one is needed, ms.
        limits: limits that the segments keep exactly and everywhere; default: those of the trajectory. With the
            registers' limits, the part that the plan does not use is available for rounding.
        deviation: largest deviation of any joint from the planned motion at the same time, rad, in addition to 1 count.
        line: tolerance of the tool on its line, or None.
        jump: largest jump of velocity at a join, (n,) rad/s; default: what the controller allows if `limits` are those
            of its registers (`vertex_jump`). A slower motion is sent with the same registers.

    Returns:
        A chain from rest at ``unit.counts`` of the first configuration to rest at those of the last.

    Raises:
        InputError: `segment_ms` is below `SHORTEST_MS`.
        ImpossibleError: limits so small that rounding to counts alone exceeds them; data: axis.
    """
    end = float(trajectory.s[-1])
    return to_marked_segments(
        trajectory,
        unit,
        segment_ms,
        limits=limits or trajectory.limits,
        marks=(end,),
        lines=(line, None),
        deviation=deviation,
        jump=jump,
    ).path


def to_marked_segments(
    trajectory: Trajectory,
    unit: Unit,
    segment_ms: int = 100,
    *,
    limits: Limits,
    marks: Sequence[float],
    lines: tuple[LineTolerance | None, LineTolerance | None] = (None, None),
    deviation: float = 2e-4,
    late: Sequence[bool] | None = None,
    jump: Array | None = None,
) -> Marked:
    """`to_segments` for a motion that begins and ends with lines, with a join of segments at each mark.

    Args:
        trajectory, unit, segment_ms, limits, deviation, jump: see `to_segments`.
        marks: increasing values of the path parameter, such as inner edges of `plan.trajectory.joint_path.Chained`.
            Each join is within 1 ms of its mark. Marks at the ends of the path need no join.
        lines: tolerance of the tool before the first mark, and after the last.
        late: for each mark, True if its join is at or after the mark, False if at or before it. Default: True for the
            last of several marks, so that lines contain nothing of a transit.

    Raises:
        InputError: `segment_ms` is below `SHORTEST_MS`.
        MarksTooNear: marks are less than `SHORTEST_MS` from each other or from an end; data: marks_ms.
        ImpossibleError: limits so small that rounding to counts alone exceeds them; data: axis.
    """
    if segment_ms < SHORTEST_MS:
        raise InputError(f"segment_ms = {segment_ms}: must be at least {SHORTEST_MS}", segment_ms=segment_ms)
    if late is None:
        late = [i > 0 and i == len(marks) - 1 for i in range(len(marks))]
    jump = vertex_jump(limits.acceleration) if jump is None else jump
    fitter = _Fitter(unit, limits, jump, deviation, tuple(marks), tuple(late), lines)
    if fitter.calm_ms(1.0) > segment_ms * _LONGEST:
        raise _too_slow(unit, int(np.argmin(fitter.acceleration())))
    calm = int(np.clip(fitter.calm_ms(0.025), segment_ms, segment_ms * _LONGEST))
    for _ in range(_ROUNDS):
        for number, (longer, factor, apart) in enumerate(_TRIES):
            if number == 0 and not _roomy(trajectory.limits, limits):
                continue
            total = max(2 * SHORTEST_MS, int(np.ceil(trajectory.duration * 1e3 * longer - 1e-6)))
            timed = trajectory.stretched(total / 1e3 / trajectory.duration)
            segments = int(factor * calm) if number else segment_ms
            fit = fitter.fit(timed, total, segments, apart, careful=number > 0)
            if fit.excess() <= 1.0:
                return fit.marked(unit.counts(timed.at([0.0]).q[0]))
        trajectory = _slower(trajectory, fit)
    raise _too_slow(unit, int(np.argmax(fit.load().max(axis=0))))


def _roomy(planned: Limits, sent: Limits) -> bool:
    """Return whether planned limits are 0.1 % below the sent ones, so that plain rounding may keep the latter."""
    return bool(
        (planned.velocity < 0.999 * sent.velocity).all()
        and (planned.acceleration < 0.999 * sent.acceleration).all()
    )


def _too_slow(unit: Unit, joint: int) -> ImpossibleError:
    return ImpossibleError(
        f"axis {unit.axes[joint]} exceeds its limits after rounding to counts, however slow the motion; "
        "raise the speed factor or the acceleration registers",
        axis=unit.axes[joint],
    )


def _slower(trajectory: Trajectory, fit: _Fit) -> Trajectory:
    """Time the path again, with each exceeded limit lowered by the excess."""
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
    """Segments for one choice of knots.

    Attributes:
        knots_ms: (k + 1,) int.
        coefficients: (3, k, n) int.
        velocity, acceleration: (k, n) largest values, relative to their limits.
        jump: (k - 1, n) jumps of velocity at joins, relative to the largest one allowed.
        off: (k,) deviation relative to its tolerance.
        first: for each mark, the index of the segment after it.
    """

    knots_ms: Counts
    coefficients: Counts
    velocity: Array
    acceleration: Array
    jump: Array
    off: Array
    first: tuple[int, ...]

    def load(self) -> Array:
        return np.maximum(self.velocity, self.acceleration)

    def excess(self) -> float:
        return float(max(self.load().max(), self.jump.max(initial=0.0)))

    def marked(self, start: Counts) -> Marked:
        rows = np.moveaxis(self.coefficients, 1, 0).tolist()
        path = CountPath(
            tuple(int(c) for c in start),
            tuple(
                Segment(int(ms), tuple(tuple(row) for row in a))
                for ms, a in zip(np.diff(self.knots_ms), rows, strict=True)
            ),
        )
        return Marked(path, self.first)


@dataclass(frozen=True, eq=False)
class _Fitter:
    unit: Unit
    limits: Limits
    jump: Array
    deviation: float
    marks: tuple[float, ...]
    late: tuple[bool, ...]
    lines: tuple[LineTolerance | None, LineTolerance | None]

    def fit(self, timed: Trajectory, total_ms: int, segment_ms: int, apart: float, careful: bool) -> _Fit:
        """Halve segments that deviate too much or exceed a limit, while they are long enough."""
        calm = max(SHORTEST_MS, self.calm_ms(0.25))
        fixed = self.mark_ms(timed, total_ms)
        knots = _first_knots(
            timed, (0, *(m for m in fixed if 0 < m < total_ms), total_ms), segment_ms, apart * calm
        )
        while True:
            fit = self.measured(timed, knots, fixed, careful)
            if not careful and fit.excess() > 1.0:
                return fit
            length = np.diff(knots)
            # halving reduces an excess only while rounding errors are small in the halves
            split = (fit.off > 1.0) & (length >= 2 * SHORTEST_MS)
            split |= (fit.load().max(axis=1) > 1.05) & (length >= 2 * calm)
            if not split.any():
                return fit
            knots = np.sort(np.concatenate([knots, knots[:-1][split] + length[split] // 2]))

    def calm_ms(self, share: float) -> float:
        """Return the duration above which nearest rounding adds at most this fraction of any acceleration limit."""
        return float(1e3 * np.sqrt(_ROUNDING / (share * self.acceleration().min())))

    def acceleration(self) -> Array:
        return np.asarray(self.limits.acceleration * np.abs(self.unit.counts_per_rad))

    def mark_ms(self, timed: Trajectory, total_ms: int) -> tuple[int, ...]:
        """Return the time of the join for each mark, ms."""
        s = np.array(self.marks)
        # near an end, where the motion is at rest, the time depends on the last digits of s
        near = 1e-9 * (timed.s[-1] - timed.s[0])
        times = np.where(s >= timed.s[-1] - near, total_ms, 1e3 * timed.passed(s))
        times = np.where(s <= timed.s[0] + near, 0.0, times)
        found = []
        for time, late in zip(times.tolist(), self.late, strict=True):
            ms = int(np.ceil(time - 1e-6) if late else np.floor(time + 1e-6))
            found.append(min(max(ms, 0), total_ms))
        stops = [0, *(m for m in found if 0 < m < total_ms), total_ms]
        if min(np.diff(stops)) < SHORTEST_MS:
            why = f"marks are at {found} ms of {total_ms} ms: must be {SHORTEST_MS} ms apart"
            raise MarksTooNear(why, marks_ms=found)
        return tuple(found)

    def measured(self, timed: Trajectory, knots: Counts, fixed: tuple[int, ...], careful: bool) -> _Fit:
        unit = self.unit
        duration = np.diff(knots)[:, None] / 1e3
        ends = timed.at(knots / 1e3)
        a = round_chain(unit, self.limits, knots, ends.q, ends.qd, careful)
        steps = a.sum(axis=0)
        starts = unit.counts(ends.q[0]) + np.cumsum(steps, axis=0) - steps

        velocity, acceleration, jump = cubic_peaks(a.astype(float), duration, np.abs(unit.counts_per_rad))
        u = _SAMPLES[:, None, None]
        executed = starts + u * (a[0] + u * (a[1] + u * a[2]))
        times = knots[:-1] / 1e3 + _SAMPLES[:, None] * duration[:, 0]
        planned = (
            unit.counts_at_zero + timed.at(times.ravel()).q.reshape(executed.shape) * unit.counts_per_rad
        )
        tolerance = 1.0 + self.deviation * np.abs(unit.counts_per_rad)
        off = (np.abs(executed - planned) / tolerance).max(axis=(0, 2))
        first = tuple(int(np.searchsorted(knots, ms)) for ms in fixed)
        parts = (slice(0, first[0] if first else len(off)), slice(first[-1] if first else 0, len(off)))
        for line, part in zip(self.lines, parts, strict=True):
            if line is not None and part.start < part.stop:
                poses = product_of_exponentials(line.robot).tool_poses(
                    unit.positions(executed[:, part]).reshape(-1, executed.shape[-1])
                )
                away = line.line.deviation(poses)
                worst = np.maximum(away.distance / line.distance, away.angle / line.angle)
                off[part] = np.maximum(off[part], worst.reshape(len(_SAMPLES), -1).max(axis=0))
        limits = self.limits
        return _Fit(
            knots,
            a,
            velocity / limits.velocity,
            acceleration / limits.acceleration,
            jump / self.jump,
            off,
            first,
        )


def _first_knots(timed: Trajectory, fixed: Sequence[int], segment_ms: int, apart_ms: float) -> Counts:
    """Return knots at the fixed times, at switches of the acceleration, and evenly between them, in ms.

    Knots at switches are at least `apart_ms` from the others.
    """
    switches = np.rint(timed.switches() * 1e3).astype(int)
    knots = [0]
    for begin, end in pairwise(fixed):
        stops, apart = [begin], min(apart_ms, segment_ms)
        for switch in switches[(switches > begin) & (switches < end)]:
            # a switch too near to another knot gets a knot as near as allowed
            knot = int(min(max(switch, np.ceil(stops[-1] + apart)), np.floor(end - apart)))
            if knot - stops[-1] >= apart:
                stops.append(knot)
        for a, b in pairwise([*stops, end]):
            parts = max(1, int(np.ceil((b - a) / segment_ms)))
            knots.extend(a + (b - a) * i // parts for i in range(1, parts + 1))
    return np.array(knots, dtype=np.int64)
