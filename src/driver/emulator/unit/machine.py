"""The emulated controller without its serial line: axes, path generator, gripper, faults. Time passes in `run` only.

There are two kinds of position. Until an axis is homed, the unit counts from its position at power-up. The true
position is in the homed convention, in which an axis reads 0 at its mark. `offset` is the difference, 0 once homed.
"""

from __future__ import annotations

import math
import operator
from collections import deque
from collections.abc import Sequence

import numpy as np

from arm.controller.unit import Unit
from driver.emulator.options import EmulatorOptions
from driver.emulator.unit.axes import AxisMove, GripperJaws
from driver.emulator.unit.defects import Defects
from driver.emulator.unit.following import Following
from driver.emulator.unit.limit_watch import LimitWatch
from driver.emulator.unit.path_generator import PathGenerator
from driver.emulator.unit.plant import ContactPlant, Plant
from driver.emulator.unit.record import Recorder, Violation
from driver.emulator.unit.segment import QueuedSegment
from driver.line.protocol import ARM_POWER_OFF, AXIS_ERROR, BUSY, MOTION_STOP, NO_ROOM

_GRIPPER_ACCELERATION = 51  # counts/256 per ms^2, until REGACC is set
_LEAST_ROOM = 50  # NO_ROOM is not set only if the queue has room for more segments than this


class Machine:
    """State of the unit and its arm.

    Args:
        unit: the arm and controller to emulate.
        plant: what the gripper acts upon, or None.
        options: behaviour.

    Attributes:
        now_ms: emulated time.
        booted_ms: time of the last power-up; the unit's own clock counts from then.
        registers: name with axis to value, as set.
        group: axes of the coordinated group, empty if not formed.
        axis_errors: axes in error.
        power, motion_stop: arm power is on; motion stop is pressed.
        following, defects: present defects of the arm and of the unit.
        halt_at_segment: `run` returns early when this many segments have begun since power-up.
        violations: commands that a correct driver never sends; the latest `EmulatorOptions.keep_lines`.
        violated: total number of violations.
    """

    def __init__(self, unit: Unit, plant: Plant | None, options: EmulatorOptions) -> None:
        self.unit = unit
        self.plant = plant
        self.options = options
        self.now_ms = 0
        self.booted_ms = 0
        true = tuple(int(c) for c in unit.counts(np.radians(options.power_up_deg)))
        self.offset = true  # true position = position in the unit's counts + offset
        self.path = PathGenerator((0,) * len(true))
        self.moves: dict[int, AxisMove] = {}
        self._homing: set[int] = set()
        # arguments of `append` that wait until the arm is at rest, as the start of their segment is not known before
        self._held: deque[tuple[float, Sequence[Sequence[int]], bool]] = deque()
        self.jaws = GripperJaws(unit.gripper.open_adc, unit.gripper.closed_adc)
        self.registers = self._power_up_registers()
        self.group: tuple[str, ...] = ()
        self.axis_errors: set[str] = set()
        self.power = True
        self.motion_stop = False
        self.following = Following(unit.axes)
        self.defects = Defects()
        self.halt_at_segment = math.inf
        self.violations: deque[Violation] = deque(maxlen=options.keep_lines)
        self.violated = 0
        self.recorder = Recorder(len(true), options.keep_ms)
        self._numbers = 0
        self._random = np.random.default_rng(options.seed)
        self._static = (0,) * len(true)
        self._limits = LimitWatch(unit)
        self._limits_due = True  # the arm may have moved since they were checked

    def _power_up_registers(self) -> dict[str, float]:
        registers: dict[str, float] = {"COORDDISCONT": self.options.vertex_steps}
        unit = self.unit
        limits = zip(unit.axes, unit.speed_registers, unit.acceleration_registers, strict=True)
        for axis, speed, acceleration in limits:
            registers[f"REGMS{axis}"], registers[f"REGACC{axis}"] = speed, acceleration
        return registers

    # -- queries

    def actual(self) -> tuple[int, ...]:
        """Return the position without contact: reference, following error and, at rest, static error."""
        at = self.following.apply(self.path.at)
        if self.arm_busy or not self.options.static_error:
            return at
        return tuple(a + e for a, e in zip(at, self._static, strict=True))

    def read(self) -> tuple[int, ...]:
        """Return the position that the unit answers: the actual one, and what contact does to it."""
        actual = self.actual()
        if not isinstance(self.plant, ContactPlant):
            return actual
        return tuple(map(operator.add, actual, self.plant.pushed_back(self.true_counts())))

    def true_counts(self) -> tuple[int, ...]:
        """Return the true position of the arm, in the homed convention."""
        return tuple(map(operator.add, self.actual(), self.offset))

    @property
    def coordinated(self) -> bool:
        """Whether segments of the group run or wait."""
        return bool(self.path.queue or self._held)

    @property
    def arm_busy(self) -> bool:
        """Whether an axis of the arm generates motion, or is about to."""
        return bool(self.path.queue or self.moves or self._held)

    @property
    def busy(self) -> bool:
        """Whether an axis of the arm or the gripper generates motion."""
        return self.arm_busy or self.jaws.move is not None

    def jaws_adc(self) -> int:
        """Return the position of the jaws, ADC counts."""
        if isinstance(self.plant, ContactPlant) and self.jaws.move is None:
            self.jaws.slip(self.plant.jaws_now(self.true_counts(), self.jaws.adc))
        return self.jaws.adc

    def axis_busy(self, axis: str) -> bool:
        """Whether an axis generates motion."""
        if axis == self.unit.gripper.axis:
            return self.jaws.move is not None
        if axis not in self.unit.axes:
            return False
        in_group = self.coordinated and axis in self.group
        return in_group or self.unit.axes.index(axis) in self.moves

    @property
    def faulty(self) -> bool:
        """Whether a fault forbids motion."""
        return bool(self.axis_errors) or not self.power or self.motion_stop

    def status(self) -> int:
        """Return the status word."""
        free = self.queue_limit - len(self.path.queue) - len(self._held)
        bits = (
            (bool(self.axis_errors), AXIS_ERROR),
            (self.busy, BUSY),
            (free <= _LEAST_ROOM, NO_ROOM),
            (not self.power, ARM_POWER_OFF),
            (self.motion_stop, MOTION_STOP),
        )
        return sum(mask for on, mask in bits if on)

    @property
    def queue_limit(self) -> int:
        """Present capacity of the queue, segments."""
        return self.options.queue if self.defects.queue is None else self.defects.queue

    def violate(self, what: str) -> None:
        """Record a command that a correct driver never sends."""
        self.violated += 1
        self.violations.append(Violation(self.now_ms, what))

    # -- commands

    def append(self, least_ms: float, rows: Sequence[Sequence[int]], absolute: bool) -> bool:
        """COORDMV, COORDMVT, COORDRELMVT, COORDSPLINET. Return False if the queue is full.

        Args:
            least_ms: shortest time; 0: as fast as the limits allow.
            rows: coefficients a1, a2, .. per axis of the group.
            absolute: each row is the target of a straight segment instead, counts.
        """
        if self.faulty:
            self.violate("motion commanded during a fault")
            return True
        if len(self.path.queue) + len(self._held) >= self.queue_limit:
            self.violate(f"segment beyond the queue's {self.queue_limit}")
            return False
        if self.defects.drop_segments:
            self.defects.drop_segments -= 1
            return True
        self._held.append((least_ms, rows, absolute))
        self._admit()
        return True

    def _admit(self) -> None:
        """Queue the held segments, unless the arm still brakes or single axes move."""
        while self._held and not self.path.stopping and not self.moves:
            self._queue(*self._held.popleft())

    def _queue(self, least_ms: float, given: Sequence[Sequence[int]], absolute: bool) -> None:
        start = self.path.end
        rows: list[Sequence[int]] = [(0,)] * len(start)
        for axis, row in zip(self.group, given, strict=True):
            index = self.unit.axes.index(axis)
            rows[index] = (row[0] - start[index],) if absolute else row
        self._numbers = self._numbers % 0x7FFF + 1
        speed = [self.registers[f"REGMS{a}"] / 256.0 for a in self.unit.axes]
        acceleration = [self.registers[f"REGACC{a}"] / 256.0 for a in self.unit.axes]
        segment = QueuedSegment(start, rows, least_ms, speed, acceleration, self._numbers)
        self.path.append(segment, self.registers["COORDDISCONT"])

    def move_axis(self, axis: str, target: float) -> None:
        """G: move one axis."""
        if axis == self.unit.gripper.axis:
            self._move_jaws(target)
        else:
            self._start_axis(axis, target)

    def run_axis(self, axis: str, speed: float, duration_ms: float = math.inf) -> None:
        """SPD, SPDT: constant speed, counts/ms."""
        self._start_axis(axis, None, speed, duration_ms)

    def home(self, axis: str) -> None:
        """HH: move to the mark, which is 0 then."""
        if axis in self.unit.axes:
            index = self.unit.axes.index(axis)
            speed = self.registers[f"REGMS{axis}"] / 256.0 * self.options.homing_speed
            mark = -float(self.offset[index]) - self.following.off(index)
            if self._start_axis(axis, mark, speed):
                self._homing.add(index)

    def _start_axis(
        self, axis: str, target: float | None, speed: float | None = None, duration_ms: float = math.inf
    ) -> bool:
        if axis not in self.unit.axes:
            return False
        if self.faulty or self.path.queue:
            when = "during a fault" if self.faulty else "while the group moves"
            self.violate(f"axis {axis} commanded {when}")
            return False
        index = self.unit.axes.index(axis)
        self._homing.discard(index)
        self.moves[index] = AxisMove(
            self.path.at[index],
            target,
            self.registers[f"REGMS{axis}"] / 256.0 if speed is None else speed,
            self.registers[f"REGACC{axis}"] / 256.0,
            duration_ms,
        )
        return True

    def _move_jaws(self, target: float) -> None:
        if self.faulty:
            self.violate("gripper commanded during a fault")
            return
        reach = self.jaws.within_stroke(target)
        axis, gripper = self.unit.gripper.axis, self.unit.gripper
        closing = (reach - self.jaws.adc) * (gripper.closed_adc - gripper.open_adc) > 0
        if closing and self.defects.miss_grasps:
            self.defects.miss_grasps -= 1
            stop = reach
        else:
            stop = (
                reach if self.plant is None else self.plant.jaws(self.true_counts(), self.jaws_adc(), reach)
            )
        if self.faulty:  # the plant has injected a fault
            return
        speed = self.registers.get(f"REGMS{axis}", self.unit.gripper.registers["REGMS"]) / 256.0
        acceleration = self.registers.get(f"REGACC{axis}", _GRIPPER_ACCELERATION) / 256.0
        self.jaws.go(target, stop, speed, acceleration)

    def stop(self, axis: str = "") -> None:
        """STOP, and the same part of PURGE: clear the queue, brake on the path, hold."""
        if axis == self.unit.gripper.axis:
            self.jaws.release()
        elif axis in ("", *self.group):
            self._held.clear()
            self.path.stop()
        for index, move in self.moves.items():
            if axis in ("", self.unit.axes[index]):
                self._homing.discard(index)
                move.stop()
        if not axis and self.jaws.move is not None:
            self.jaws.release()

    def purge(self, axis: str = "") -> None:
        """PURGE: stop, and clear axis errors."""
        self.stop(axis)
        self.axis_errors -= {axis} if axis else set(self.axis_errors)

    def release(self, axis: str = "") -> None:
        """RELEASE: switch off the current; the brakes hold at once."""
        if axis == self.unit.gripper.axis:
            self.jaws.release()
            return
        if self.arm_busy:
            self.violate("released while moving")
        self.freeze()

    def freeze(self) -> None:
        """Engage the brakes: the arm stops where it is, and all motion is discarded."""
        self.path.abort()
        self.moves.clear()
        self._homing.clear()
        self._held.clear()
        self.jaws.release()

    def power_cycle(self) -> None:
        """Switch off and on: every axis counts from 0 where it is, and all settings are lost."""
        self.freeze()
        self.offset = self.true_counts()
        self.path = PathGenerator((0,) * len(self.offset))
        self.following.forget()
        self._static = (0,) * len(self.offset)
        self.registers = self._power_up_registers()
        self.group = ()
        self.axis_errors.clear()
        self._numbers = 0
        self.booted_ms = self.now_ms

    # -- time

    def run(self, ticks: int) -> None:
        """Let that many ms pass. Ends early at `halt_at_segment`."""
        until = self.now_ms + ticks
        while self.now_ms < until and self.path.begun < self.halt_at_segment:
            moving = self.arm_busy
            if not moving and self.jaws.move is None:
                break
            self.now_ms += 1
            if self.moves:
                self._tick_axes()
            elif self.path.queue:
                self.path.tick()
            if self._held:
                self._admit()
            self.jaws.tick()
            if self.following.active:
                self.following.run(self.path.at, 1.0)
            if moving:
                if not self.arm_busy:
                    self._settle()
                self.recorder.add(self.now_ms, self.true_counts())
                self._limits_due = True
        if self.path.begun < self.halt_at_segment:
            self.following.run(self.path.at, until - self.now_ms)
            self.now_ms = until
        if self._limits_due or self.following.active:
            self._limits_due = False
            for axis, value, low, high in self._limits.newly_outside(self.true_counts()):
                self.violate(f"axis {axis} at {value} counts: must be from {low} to {high}")

    def _tick_axes(self) -> None:
        at = list(self.path.at)
        for index, move in list(self.moves.items()):
            move.tick()
            at[index] = round(move.at)
            if move.done and not (index in self._homing and self.following.is_stuck(index)):
                del self.moves[index]
                if index in self._homing:
                    self._homing.discard(index)
                    self.following.mark(index)
                    self.offset = tuple(0 if i == index else o for i, o in enumerate(self.offset))
                    at[index] = 0
        self.path.at = tuple(at)

    def _settle(self) -> None:
        if most := self.options.static_error:
            self._static = tuple(int(e) for e in self._random.integers(-most, most + 1, len(self.offset)))
