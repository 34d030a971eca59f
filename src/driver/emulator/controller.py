"""The emulated MARS-8 without its serial line: lines and time in, answers and motion out. No threads, no clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from arm.unit import Unit
from driver.emulator.arm_axes import ArmAxes
from driver.emulator.axis_motion import go_to, keep_speed
from driver.emulator.grammar import Request, parse_request
from driver.emulator.jaws import Jaws
from driver.emulator.options import EmulatorOptions
from driver.emulator.plant import Plant
from driver.emulator.queued_segment import AxisLimits
from driver.emulator.record import Recorder

VERSION = "v1.0 build Pi Oct  2 2017 11:06:45"  # of the unit at CTU, behind the firmware's name
_GRIPPER_SPEED, _GRIPPER_ACCELERATION = 500, 20  # registers at power-up, counts/256 per ms and ms^2
_HIGHEST_ORDER = 7
_MOST_WAITS = 64
_COORDINATED = ("COORDMV", "COORDMVT", "COORDRELMVT", "COORDSPLINET")


@dataclass(frozen=True)
class Answer:
    """A line that the unit says (without its end) at a time in ms."""

    time_ms: float
    text: str


@dataclass(frozen=True)
class _Wait:
    """An ``R:`` or ``Rx:`` that is not answered yet."""

    axis: str
    since_ms: float


class Controller:
    """The unit's behaviour; deterministic in its lines and their times.

    Args:
        unit: which arm and controller.
        plant: what the jaws meet.
        options: see `EmulatorOptions`.

    Attributes:
        echo: received characters are sent back.
        answers: what the unit has said and nobody has taken yet, oldest first.
        recorder: executed motion and broken rules.
    """

    def __init__(self, unit: Unit, plant: Plant, options: EmulatorOptions) -> None:
        self.unit = unit
        self.options = options
        self.plant = plant
        self.answers: list[Answer] = []
        self.recorder = Recorder(options.record_ms)
        self._power_up()

    def _power_up(self) -> None:
        self.echo = True
        self.arm = ArmAxes(self.unit, self.options, self.recorder)
        self.jaws = Jaws(self.unit.gripper, self.plant)
        self.arm_power = True
        self.motion_stop = False
        self.failed_axes: set[str] = set()
        self.vertex_steps = self.options.vertex_steps
        self.registers: dict[str, int] = {
            f"REGMS{self.unit.gripper.axis}": _GRIPPER_SPEED,
            f"REGACC{self.unit.gripper.axis}": _GRIPPER_ACCELERATION,
        }
        for axis, speed, acceleration in zip(
            self.unit.axes, self.unit.speed_registers, self.unit.acceleration_registers, strict=True
        ):
            self.registers[f"REGMS{axis}"] = speed
            self.registers[f"REGACC{axis}"] = acceleration
        self._waits: list[_Wait] = []
        self._after_stop: list[Request] = []
        self._line_ms = 0.0

    # -- time and state

    @property
    def time_ms(self) -> int:
        """Until which everything is executed."""
        return self.arm.time_ms

    @property
    def busy(self) -> bool:
        """Something moves, or will be answered without being asked again."""
        return self.arm.busy() or self.jaws.busy or bool(self._waits)

    @property
    def fault(self) -> bool:
        """Motion is impossible."""
        return not self.arm_power or self.motion_stop or bool(self.failed_axes)

    def status(self) -> int:
        """The status word (fact sheet, section 1.1)."""
        moving = self.arm.busy() or self.jaws.busy
        return (
            (0x8 if self.failed_axes else 0)
            | (0x10 if moving else 0)
            | (0x80 if self.arm.planner.nearly_full else 0)
            | (0 if self.arm_power else 0x10000)
            | (0x20000 if self.motion_stop else 0)
        )

    def advance(self, to_ms: int) -> None:
        """Execute everything up to a time."""
        if to_ms <= self.time_ms:
            return
        self.arm.advance(to_ms)
        self.jaws.advance(to_ms)
        if self._after_stop and not self.arm.planner.busy:
            held, self._after_stop = self._after_stop, []
            for request in held:
                self._obey(request)
        self._answer_waits()

    def receive(self, line: bytes, time_ms: float) -> None:
        """Take one line (without its end) that is complete at a time."""
        self.advance(int(time_ms))
        self._line_ms = time_ms
        if not line.strip(b" \r\0"):
            return
        request = parse_request(line)
        if request is None:
            self._malformed(line.decode("latin-1"))
        else:
            self._obey(request)
        self._answer_waits()

    # -- what can happen to the unit (fault scripts call these)

    def set_arm_power(self, on: bool) -> None:
        """The yellow button. Without power the brakes hold the arm; positions are kept."""
        self.arm_power = on
        self._after_fault()

    def set_motion_stop(self, pressed: bool) -> None:
        """The stop button."""
        self.motion_stop = pressed
        self._after_fault()

    def fail_axis(self, axis: str) -> None:
        """An axis goes into error until ``PURGE:``."""
        self.failed_axes.add(axis)
        self._after_fault()

    def power_cycle(self) -> None:
        """Off and on: positions are lost, the arm stays where it is."""
        where, time_ms = self.arm.true_counts(), self.time_ms
        self._power_up()
        self.arm.place(where)
        self.arm.time_ms = time_ms

    def _after_fault(self) -> None:
        if self.fault:
            self.arm.freeze()
            self.jaws.freeze(self.time_ms)
            self._after_stop.clear()
        self._line_ms = float(self.time_ms)
        self._answer_waits()

    # -- answering

    def _say(self, text: str, time_ms: float | None = None) -> None:
        self.answers.append(Answer(self._line_ms if time_ms is None else time_ms, text))

    def _tell(self, rule: str, detail: str) -> None:
        self.recorder.tell(self.time_ms, rule, detail)

    def _malformed(self, line: str) -> None:
        self._tell("unknown", f"line {line[:80]!r}")
        if self.options.unknown != "silent":
            self._say("FAIL!" if self.options.unknown == "fail" else "ERROR 1")

    def _answer_waits(self) -> None:
        waiting: list[_Wait] = []
        for wait in self._waits:
            ready_ms = self._ready_ms(wait.axis)
            if self.fault:
                self._say("FAIL!", max(wait.since_ms, self._line_ms))
            elif ready_ms is None:
                waiting.append(wait)
            else:
                self._say(f"R{wait.axis}!", max(wait.since_ms, ready_ms))
        self._waits = waiting

    def _ready_ms(self, axis: str) -> float | None:
        """When an axis (or "" for all) became idle; None while it is busy."""
        axes = range(6) if axis == "" else [k for k, a in enumerate(self.unit.axes) if a == axis]
        with_jaws = axis in ("", self.unit.gripper.axis)
        if self.arm.busy(axes) or (with_jaws and self.jaws.busy):
            return None
        ends = [self.arm.busy_until(axes)] if axes else [0.0]
        return max([*ends, self.jaws.busy_until] if with_jaws else ends)

    # -- obeying

    def _obey(self, request: Request) -> None:
        if request.asked:
            self._answer_query(request)
        elif request.name in _COORDINATED:
            self._coordinated(request)
        elif request.name.startswith("REG") or request.name in ("ANAXSETUP", "IDLEREL", "PWM"):
            self._set_register(request)
        else:
            handlers: dict[str, Callable[[Request], None]] = {
                "ECHO": self._set_echo,
                "STAMP": self._stamp,
                "R": self._wait,
                "STOP": self._stop,
                "PURGE": self._purge,
                "RELEASE": self._release,
                "HH": self._home,
                "G": self._go,
                "SPD": self._spin,
                "SPDT": self._spin,
                "COORDGRP": self._form_group,
                "COORDDISCONT": self._set_vertex_steps,
            }
            handler = handlers.get(request.name)
            if handler is None:
                self._malformed(f"{request.name}{request.axis}:{request.text}")
            else:
                handler(request)

    def _answer_query(self, request: Request) -> None:
        key = request.name + request.axis
        match request.name:
            case "VER":
                self._say(f"VER={self.unit.firmware} {VERSION}")
            case "ST" if not request.axis:
                self._say(f"ST={self.status()}")
            case "AP":
                self._say(f"{key}={self._position(request.axis)}")
            case "COORDAP":
                self._say_group()
            case "DIGI1":
                self._say("DIGI1=0")
            case "COORDDISCONT" if self.options.registers_readable:
                self._say(f"{key}={self.vertex_steps}")
            case _ if self.options.registers_readable and key in self.registers:
                self._say(f"{key}={self.registers[key]}")
            case _:
                self._malformed(f"{key}?")

    def _position(self, axis: str) -> int:
        if axis == self.unit.gripper.axis:
            return self.jaws.position()
        return self.arm.told()[self.unit.axes.index(axis)] if axis in self.unit.axes else 0

    def _say_group(self) -> None:
        planner, told = self.arm.planner, self.arm.told()
        parameter = 1 + int(planner.parameter * 0xFFFE) if planner.busy else 0
        values = (self.time_ms & 0xFFFF, planner.running, parameter, *(told[k] for k in self.arm.group))
        self._say("COORDAP=" + ",".join(str(v) for v in values))

    def _values(self, request: Request, count: int, whole: bool = True) -> list[int] | None:
        values = request.numbers(whole)
        if values is None or len(values) != count:
            self._malformed(f"{request.name}{request.axis}:{request.text}")
            return None
        return values

    def _set_echo(self, request: Request) -> None:
        if values := self._values(request, 1):
            self.echo = values[0] != 0

    def _stamp(self, request: Request) -> None:
        if values := self._values(request, 1):
            self._say(f"STAMP={values[0] & 0x7FFF}")

    def _wait(self, request: Request) -> None:
        if len(self._waits) < _MOST_WAITS:
            self._waits.append(_Wait(request.axis, self._line_ms))

    def _set_register(self, request: Request) -> None:
        values = request.numbers(whole=False)
        if not values:
            self._malformed(f"{request.name}{request.axis}:{request.text}")
            return
        if request.name in ("REGMS", "REGACC") and values[0] < 1:
            self._tell("value", f"{request.name}{request.axis} = {values[0]}")
            return
        self.registers[request.name + request.axis] = values[0]
        if request.name == "REGMS" and request.axis in self.unit.axes:
            cap = self.unit.speed_register_cap()[self.unit.axes.index(request.axis)]
            if values[0] > cap:
                self._tell("speed", f"REGMS{request.axis} = {values[0]}, the most allowed is {cap}")

    def _set_vertex_steps(self, request: Request) -> None:
        if (values := self._values(request, 1)) and values[0] >= 0:
            self.vertex_steps = values[0]

    def _form_group(self, request: Request) -> None:
        letters = [part.strip() for part in request.text.split(",") if part.strip()]
        axes = tuple(self.unit.axes.index(a) for a in letters if a in self.unit.axes)
        if len(axes) != len(letters) or len(set(axes)) != len(axes):
            self._malformed(f"COORDGRP:{request.text}")
        elif self.arm.planner.busy:
            if axes != self.arm.group:
                self._tell("order", "COORDGRP while the group moves")
        else:
            self.arm.form_group(axes)

    # -- stopping

    def _stop(self, request: Request) -> None:
        axes = self._axes(request)
        self._after_stop.clear()
        self.arm.stop(axes)
        if request.axis in ("", self.unit.gripper.axis):
            self.jaws.stop(self.time_ms)

    def _purge(self, request: Request) -> None:
        self.failed_axes -= {request.axis} if request.axis else set(self.failed_axes)
        self._stop(request)

    def _release(self, request: Request) -> None:
        if request.axis in ("", *self.unit.axes):
            self._after_stop.clear()
            self.arm.freeze()
        if request.axis in ("", self.unit.gripper.axis):
            self.jaws.freeze(self.time_ms)

    def _axes(self, request: Request) -> list[int]:
        return [k for k, a in enumerate(self.unit.axes) if request.axis in ("", a)]

    # -- moving

    def _may_move(self, request: Request, axes: tuple[int, ...] | list[int]) -> bool:
        """Whether a motion is possible; notes why not."""
        if self.fault:
            self._tell("refused", f"{request.name}{request.axis} without power, or in error")
        elif request.name not in _COORDINATED and self.arm.busy(axes):
            self._tell("order", f"{request.name}{request.axis} while the axis moves")
        else:
            if request.name not in ("HH", "SPDT") and not all(self.arm.homed[k] for k in axes):
                self._tell("unhomed", f"{request.name}{request.axis} before homing")
            return True
        return False

    def _speed(self, axis: str) -> float:
        return self.registers[f"REGMS{axis}"] / 256.0

    def _acceleration(self, axis: str) -> float:
        return self.registers[f"REGACC{axis}"] / 256.0

    def _home(self, request: Request) -> None:
        for axis in self._axes(request):
            if request.axis and self._may_move(request, [axis]):
                speed = self._speed(request.axis) * self.options.homing_speed
                motion = go_to(
                    self.time_ms,
                    self.arm.reference(axis),
                    self.arm.mark(axis),
                    speed,
                    self._acceleration(request.axis),
                    homes=True,
                )
                self.arm.start(axis, motion)

    def _go(self, request: Request) -> None:
        values = self._values(request, 1, whole=False)
        if values is None or not self._may_move(request, self._axes(request)):
            return
        if request.axis == self.unit.gripper.axis:
            self.jaws.go(
                values[0],
                self.arm.true_counts(),
                self.time_ms,
                self._speed(request.axis),
                self._acceleration(request.axis),
            )
        for axis in self._axes(request):
            start, speed = self.arm.reference(axis), self._speed(request.axis)
            self.arm.start(
                axis, go_to(self.time_ms, start, values[0], speed, self._acceleration(request.axis))
            )

    def _spin(self, request: Request) -> None:
        values = self._values(request, 2 if request.name == "SPDT" else 1)
        axes = self._axes(request)
        if values is None:
            return
        if request.name == "SPD" and values[0] == 0:
            self.arm.stop(axes)
        elif self._may_move(request, axes):
            length = float(values[1]) if request.name == "SPDT" else float("inf")
            for axis in axes:
                start, acceleration = self.arm.reference(axis), self._acceleration(request.axis)
                self.arm.start(axis, keep_speed(self.time_ms, start, values[0] / 256.0, acceleration, length))

    def _coordinated(self, request: Request) -> None:
        values, group = request.numbers(), self.arm.group
        timed = request.name != "COORDMV"
        if not values or not group or (timed and values[0] < 0):
            self._malformed(f"{request.name}:{request.text}")
            return
        duration_ms, rest = (values[0], values[1:]) if timed else (0, values)
        order = 1
        if request.name == "COORDSPLINET" and rest:
            order, rest = rest[0], rest[1:]
        if not 1 <= order <= _HIGHEST_ORDER or len(rest) != order * len(group):
            self._malformed(f"{request.name}:{request.text}")
        elif not self._may_move(request, group):
            return
        elif self.arm.planner.stopping and len(self._after_stop) < 200:
            self._after_stop.append(request)
        elif self.arm.planner.full or self.arm.planner.stopping:
            self._tell("overflow", "a segment found the queue full")
            if self.options.overflow == "fail":
                self._say("FAIL!")
        else:
            coefficients = np.array(rest, dtype=np.int64).reshape(len(group), order).T
            if request.name in ("COORDMV", "COORDMVT"):
                coefficients = coefficients - self.arm.path_end()
            self.arm.queue(coefficients, duration_ms, self._limits())

    def _limits(self) -> AxisLimits:
        letters = [self.unit.axes[k] for k in self.arm.group]
        return AxisLimits(
            speed=np.array([self._speed(a) for a in letters]),
            acceleration=np.array([self._acceleration(a) for a in letters]),
            vertex_steps=self.vertex_steps,
        )
