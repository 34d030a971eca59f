"""Execute the unit's command lines: one line in, its answers out. Knows nothing of ports or baud rates.

A successful command has no answer. ``R:`` is answered later, by `Interpreter.ready`. Integers may be written with
decimals (ctu_crs sends ``REGMSA:7680.0``). The options define the answer to an unknown line. Source:
docs/sources.md, "Lines and commands", "Coordinated motion" and "Public clients".
"""

from __future__ import annotations

import re
from collections import deque

from driver.emulator.unit.machine import Machine

_LINE = re.compile(r"([A-Z][A-Z0-9]*?)(\?:?|:)(.*)")
_INT32 = 2**31
_MOST_WAITS = 100  # outstanding at once; more is a violation
_AXIS_NAMES = (
    "REGACC", "REGMODE", "REGTYPE", "REGCFG", "REGME", "REGMS", "REGS1", "REGS2", "REGP", "REGI", "REGD",
    "ANAXSETUP", "SPDFG", "SPDT", "SPD", "PWM", "HH", "AP", "ST", "STOP", "RELEASE", "PURGE", "R", "G",
)  # fmt: skip
_KEPT = ("IDLEREL", "REGPWRON", "REGPWRFLG", "COORDDISCONT")  # registers without an axis


class NotUnderstoodError(Exception):
    """The unit does not understand a line."""


class Interpreter:
    """Parses and executes lines for one machine, and keeps the pending waits for ``R!``.

    Attributes:
        echo: whether received characters are echoed; on after power-up.
        lines: lines received, with emulated ms; the latest `EmulatorOptions.keep_lines`.
        ignored: those that were not understood, likewise.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.echo = True
        self.lines: deque[tuple[int, str]] = deque(maxlen=machine.options.keep_lines)
        self.ignored: deque[tuple[int, str]] = deque(maxlen=machine.options.keep_lines)
        self._waits: list[str] = []

    def take(self, line: str) -> list[str]:
        """Execute one line (without its end). Return the answers, in order, without their ends."""
        text = line.strip()
        if not text:
            return []
        self.lines.append((self.machine.now_ms, text))
        try:
            answers = self._obey(text)
        except NotUnderstoodError:
            self.ignored.append((self.machine.now_ms, text))
            return ["FAIL!"] if self.machine.options.unknown == "fail" else []
        return answers + self.ready()

    def power_up(self) -> None:
        """Reset to the state after power-up: echo on, no waits."""
        self.echo = True
        self._waits.clear()

    @property
    def waiting(self) -> bool:
        """Whether a client waits for ``R!``."""
        return bool(self._waits)

    def ready(self) -> list[str]:
        """Return ``R!``, ``Rx!`` or ``FAIL!`` for every wait that has ended."""
        answers, still = [], []
        defects = self.machine.defects
        for axis in self._waits:
            if defects.fail_replies:
                defects.fail_replies -= 1
                answers.append("FAIL!")
            elif self.machine.faulty:
                answers.append("FAIL!")
            elif defects.early_ready:
                defects.early_ready -= 1
                answers.append(f"R{axis}!")
            elif self.machine.axis_busy(axis) if axis else self.machine.busy:
                still.append(axis)
            else:
                answers.append(f"R{axis}!")
        self._waits = still
        return answers

    # -- one line

    def _obey(self, line: str) -> list[str]:
        match = _LINE.fullmatch(line)
        if match is None:
            raise NotUnderstoodError
        name, mark, rest = match.groups()
        if mark.startswith("?"):
            return self._answer(name)
        if self._obey_global(name, rest):
            return [] if name != "STAMP" else [f"STAMP={int(_numbers(rest)[0])}"]
        if name.startswith("COORD"):
            return self._obey_coordinated(name, rest)
        self._obey_axis(*_split(name), rest)
        return []

    def _answer(self, name: str) -> list[str]:
        machine = self.machine
        match name:
            case "VER":
                return [f"VER={machine.options.version}"]
            case "ST":
                return [f"ST={machine.status()}"]
            case "COORDAP" if machine.group:
                read = machine.read()
                positions = [read[machine.unit.axes.index(a)] for a in machine.group]
                clock_ms = (machine.now_ms - machine.booted_ms) & 0xFFFF
                parameter = 1 + int(machine.path.u * 65534) if machine.path.queue else 0
                values = (clock_ms, machine.path.number, parameter, *positions)
                return ["COORDAP=" + ",".join(map(str, values))]
            case _:
                return self._answer_axis(name)

    def _answer_axis(self, name: str) -> list[str]:
        machine = self.machine
        if machine.options.registers_readable and name in machine.registers:
            return [f"{name}={machine.registers[name]:g}"]
        base, axis = _split(name)
        if base != "AP" or not axis:
            raise NotUnderstoodError
        if axis == machine.unit.gripper.axis:
            return [f"{name}={machine.jaws_adc()}"]
        if axis not in machine.unit.axes:
            return [f"{name}=0"]
        return [f"{name}={machine.read()[machine.unit.axes.index(axis)]}"]

    def _obey_global(self, name: str, rest: str) -> bool:
        """Execute a command without an axis, except coordinated motion; return False if it is not one."""
        if name == "ECHO":
            self.echo = bool(_numbers(rest, 1)[0])
        elif name == "STAMP":
            if not 0 <= _numbers(rest, 1)[0] <= 0x7FFF:
                raise NotUnderstoodError
        elif name == "COORDGRP":
            self._form(rest)
        elif name in _KEPT:
            self.machine.registers[name] = max(_numbers(rest, 1)[0], 0.0)
        else:
            return False
        return True

    def _form(self, rest: str) -> None:
        axes = tuple(a.strip() for a in rest.split(",") if a.strip())
        if len(set(axes)) != len(axes) or any(a not in self.machine.unit.axes for a in axes):
            raise NotUnderstoodError
        if self.machine.coordinated:
            self.machine.violate("group changed while it moves")
            return
        self.machine.group = axes

    def _obey_coordinated(self, name: str, rest: str) -> list[str]:
        machine, axes = self.machine, len(self.machine.group)
        if not axes:
            raise NotUnderstoodError
        numbers = _numbers(rest)
        values = [round(v) for v in numbers]
        least_ms, rows = max(numbers[0], 0.0), [[v] for v in values[1:]]
        if name == "COORDMV" and len(values) == axes:
            least_ms, rows = 0.0, [[v] for v in values]
        elif name == "COORDSPLINET" and len(values) > 2 and len(values) == 2 + axes * values[1]:
            order = values[1]
            rows = [values[2 + k * order : 2 + (k + 1) * order] for k in range(axes)]
        elif name not in ("COORDMVT", "COORDRELMVT") or len(values) != 1 + axes:
            raise NotUnderstoodError
        taken = machine.append(least_ms, rows, absolute=name in ("COORDMV", "COORDMVT"))
        return [] if taken or machine.options.overflow == "drop" else ["FAIL!"]

    def _wait(self, axis: str) -> None:
        if len(self._waits) < _MOST_WAITS:
            self._waits.append(axis)
        else:
            self.machine.violate(f"more than {_MOST_WAITS} waits outstanding")

    def _obey_axis(self, name: str, axis: str, rest: str) -> None:
        machine = self.machine
        if name in ("STOP", "PURGE", "RELEASE", "R"):
            if rest:
                raise NotUnderstoodError
            obey = {"STOP": machine.stop, "PURGE": machine.purge, "RELEASE": machine.release, "R": self._wait}
            obey[name](axis)
            return
        if not axis:
            raise NotUnderstoodError
        if name == "HH":
            machine.home(axis)
            return
        numbers = _numbers(rest)
        match name:
            case "G" if len(numbers) == 1:
                machine.move_axis(axis, float(round(numbers[0])))
            case "SPD" if len(numbers) == 1:
                machine.run_axis(axis, numbers[0] / 256.0)
            case "SPDT" if len(numbers) == 2:
                machine.run_axis(axis, numbers[0] / 256.0, numbers[1])
            case "REGMS" | "REGACC":
                if len(numbers) != 1 or numbers[0] < 1.0:
                    raise NotUnderstoodError
                if machine.axis_busy(axis):
                    machine.violate(f"{name}{axis} changed while it moves")
                machine.registers[name + axis] = float(int(numbers[0]))
            case "AP" | "ST" | "G" | "SPD" | "SPDT":
                raise NotUnderstoodError
            case _:
                machine.registers[name + axis] = numbers[0]


def _split(name: str) -> tuple[str, str]:
    """Split into name and axis letter ("" if there is none)."""
    if name in ("STOP", "PURGE", "RELEASE", "R"):
        return name, ""
    if name[:-1] in _AXIS_NAMES and "A" <= name[-1] <= "H":
        return name[:-1], name[-1]
    raise NotUnderstoodError


def _numbers(rest: str, count: int | None = None) -> list[float]:
    try:
        values = [float(v) for v in rest.split(",")]
    except ValueError as error:
        raise NotUnderstoodError from error
    if any(not abs(v) < _INT32 for v in values) or (count is not None and len(values) != count):
        raise NotUnderstoodError
    return values
