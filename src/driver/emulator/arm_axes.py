"""The six axes of the emulated arm: where the unit believes they are, where they truly are, and what moves them.

The unit counts from 0 at power-up and learns the truth by homing: true = told + shift, and the shift is 0 once an
axis has found its mark.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from arm.unit import Unit
from driver.emulator.axis_motion import AxisMotion, brake
from driver.emulator.options import EmulatorOptions
from driver.emulator.planner import Planner
from driver.emulator.queued_segment import AxisLimits
from driver.emulator.record import Recorder

_BLOCK_MS = 1000
_POWER_UP_SPREAD = np.radians(3.0)


class ArmAxes:
    """Axes, their own motions, and the coordinated group. Indices are joints 0 to 5.

    Args:
        unit: which arm.
        options: of the emulator.
        recorder: takes every executed millisecond.

    Attributes:
        time_ms: until which everything is executed.
        homed: of each axis.
        group: axes of the coordinated group in its order; empty if none is formed.
        planner: of the group.
    """

    def __init__(self, unit: Unit, options: EmulatorOptions, recorder: Recorder) -> None:
        self.time_ms = 0
        self.homed = [False] * 6
        self.group: tuple[int, ...] = ()
        self.planner = Planner([], options.sequence_range, options.curvature_limited)
        self._unit = unit
        self._options = options
        self._recorder = recorder
        self._reference = np.zeros(6)
        self._error = np.array(options.static_error, dtype=float)
        self._shift = _power_up_counts(unit, options) - self._error
        self._motions: dict[int, AxisMotion] = {}
        self._busy_until = [0.0] * 6
        self._outside = np.zeros(6, dtype=bool)

    # -- where

    def told(self) -> tuple[int, ...]:
        """Positions as the unit tells them, (6,)."""
        return tuple(int(c) for c in np.rint(self._reference + self._error))

    def true_counts(self) -> tuple[int, ...]:
        """Positions from the homing marks, (6,), whether the unit knows them or not."""
        return tuple(int(c) for c in np.rint(self._reference + self._error + self._shift))

    # -- busy

    def busy(self, axes: Iterable[int] = range(6)) -> bool:
        """Some of the axes still generates motion."""
        return any(k in self._motions or (self.planner.busy and k in self.group) for k in axes)

    def busy_until(self, axes: Iterable[int] = range(6)) -> float:
        """When the last motion of idle axes ended, ms."""
        return max(self._busy_until[k] for k in axes)

    # -- moving

    def form_group(self, axes: tuple[int, ...]) -> None:
        """Form (or dissolve) the coordinated group while nothing of it moves."""
        sequence = self.planner.sequence
        self.group = axes
        self.planner = Planner(
            self._reference[list(axes)], self._options.sequence_range, self._options.curvature_limited
        )
        self.planner.sequence = sequence

    def path_end(self) -> npt.NDArray[np.int64]:
        """Where the group's path ends, the start of its next segment, counts in the group's order."""
        if not self.planner.busy:
            self.planner.reference = np.rint(self._reference[list(self.group)]).astype(np.int64)
        return self.planner.end

    def queue(self, coefficients: npt.NDArray[np.int64], duration_ms: int, limits: AxisLimits) -> None:
        """Queue a polynomial (order, n) of the group."""
        self.path_end()
        segment = self.planner.append(coefficients, duration_ms, limits)
        if len(coefficients) > 1 and duration_ms:
            if min(segment.rate_cap) * duration_ms < 0.999:
                self._tell("speed", f"segment {segment.sequence} needs more than its {duration_ms} ms")
            powers = np.arange(1, len(coefficients) + 1)[:, None]
            ends = np.stack([2.0 * coefficients[1], np.sum(coefficients * powers * (powers - 1), axis=0)])
            excess = np.max(np.abs(ends) / duration_ms**2 / limits.acceleration)
            if excess > 1.01:
                self._tell("acceleration", f"segment {segment.sequence} bends {excess:.2f} times its limit")

    def start(self, axis: int, motion: AxisMotion) -> None:
        """An axis moves by itself."""
        self._motions[axis] = motion

    def reference(self, axis: int) -> float:
        """Where the unit's generator has an axis."""
        return float(self._reference[axis])

    def mark(self, axis: int) -> float:
        """Where an axis' homing mark is, as the unit counts; it does not know."""
        return -float(self._shift[axis] + self._error[axis])

    def stop(self, axes: Iterable[int] = range(6)) -> None:
        """Brake at the axes' accelerations, the group on its path; forget what is queued."""
        for axis in axes:
            if axis in self.group:
                self.planner.stop()
            if axis in self._motions:
                self._motions[axis] = brake(self._motions[axis], self.time_ms)

    def freeze(self) -> None:
        """Brakes engage: everything stands at once."""
        self.planner.flush()
        self._reference[list(self.group)] = self.planner.reference
        self._busy_until = [float(self.time_ms)] * 6
        self._motions.clear()

    def advance(self, to_ms: int) -> None:
        """Execute every millisecond up to a time."""
        while self.time_ms < to_ms:
            if not self.busy():
                self.time_ms = to_ms
                return
            self._run(min(to_ms - self.time_ms, _BLOCK_MS))

    def _run(self, ticks: int) -> None:
        first = self.time_ms + 1
        rows = np.tile(self._reference, (ticks, 1))
        moving = 0
        if self.planner.busy:
            columns = list(self.group)
            stretch = self.planner.run(ticks)
            moving = len(stretch.positions)
            rows[:moving, columns] = stretch.positions
            if stretch.idle:
                rows[moving - 1 :, columns] = self.planner.reference
                for axis in columns:
                    self._busy_until[axis] = float(self.time_ms + moving)
        times = np.arange(first, first + ticks)
        for axis, motion in self._motions.items():
            rows[:, axis] = motion.positions(times)
            left = motion.end_ms - self.time_ms
            moving = max(moving, ticks if left >= ticks else math.ceil(left))
        self.time_ms += ticks
        self._keep(first, rows[:moving] + (self._error + self._shift))
        self._reference = rows[-1].copy()
        for axis in [k for k, m in self._motions.items() if m.end_ms <= self.time_ms]:
            self._finish(axis, self._motions.pop(axis))

    def _finish(self, axis: int, motion: AxisMotion) -> None:
        self._busy_until[axis] = motion.end_ms
        self._reference[axis] = round(self._reference[axis])
        if motion.homes:
            self._reference[axis] = 0.0
            self._shift[axis] = -self._error[axis]
            self.homed[axis] = True

    def _keep(self, first_ms: int, true: Array) -> None:
        self._recorder.add(first_ms, true)
        q = self._unit.positions(true)
        rounding = 1.5 / np.abs(self._unit.counts_per_rad)
        outside = np.any((q < self._unit.lower - rounding) | (q > self._unit.upper + rounding), axis=0)
        for axis in np.flatnonzero(outside & ~self._outside):
            self._tell("position", f"axis {self._unit.axes[axis]} leaves its limits")
        self._outside = outside

    def _tell(self, rule: str, detail: str) -> None:
        self._recorder.tell(self.time_ms, rule, detail)


def _power_up_counts(unit: Unit, options: EmulatorOptions) -> Array:
    if options.power_up_counts is not None:
        return np.array(options.power_up_counts, dtype=float)
    spread = np.random.default_rng(options.seed).uniform(-_POWER_UP_SPREAD, _POWER_UP_SPREAD, 6)
    return unit.counts(unit.soft_home + spread).astype(float)
