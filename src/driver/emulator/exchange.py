"""Exchange between clients and the unit: received lines to the interpreter, its answers to the clients."""

from __future__ import annotations

import math

from driver.emulator.apply_faults import FaultInjector
from driver.emulator.commands import Interpreter
from driver.emulator.line.ports import Ports
from driver.emulator.line.uart import Wire
from driver.line.wire_log import WireLog

_NEVER = 2**62


class Exchange:
    """Passes lines to the interpreter and its answers back. Not thread-safe: the emulator's lock guards it.

    Args:
        interpreter: of the unit.
        ports: with the clients' wires.
        injector: present faults.
        log: records every line, answer and violation, if given.
    """

    def __init__(
        self, interpreter: Interpreter, ports: Ports, injector: FaultInjector, log: WireLog | None
    ) -> None:
        self._interpreter = interpreter
        self._machine = interpreter.machine
        self._ports = ports
        self._injector = injector
        self._log = log
        self._logged_violations = 0
        self._waiting: list[Wire] = []  # that get ``R!``

    def next_line(self) -> tuple[Wire | None, int]:
        """Return the wire whose next line is complete first, and the ms at which it is."""
        first: Wire | None = None
        due = math.inf
        for wire in self._ports.wires:
            at = wire.next_line_at()
            if at is not None and at < due:
                first, due = wire, at
        return first, math.ceil(due) if first is not None else _NEVER

    def arrive(self, wire: Wire) -> None:
        """Take the next line of a wire, with the faults of the line applied, and execute it."""
        due, data, treated = wire.take_line()
        if not treated:
            late, data = self._injector.line.to_unit(data)
            if late > 0.0:
                wire.put_back(due + late, data)
                return
        for line in wire.assemble(data):
            self._obey(wire, line)
            wire.busy_until = self._machine.now_ms + self._machine.options.parse_ms

    def _obey(self, wire: Wire, data: bytes) -> None:
        machine, injector = self._machine, self._injector
        arrived, data = data, injector.line.to_parser(data)
        text = data.decode("latin-1")
        now = machine.now_ms
        if self._log is not None and text.strip():
            self._log.note("line", ms=now, text=text.rstrip("\r\n"))
        injector.schedule.line(text, now)
        injector.apply_due(now)
        if injector.switched_off:
            return
        echo = arrived if machine.options.echo == "line" and self._interpreter.echo else b""
        if wire.fresh:
            wire.fresh = False
            if machine.options.noise:
                wire.answer(machine.options.noise, now)
        after = machine.options.echo_order == "after"
        if echo and not after:
            self._echo(wire, echo, now)
        for answer in self._interpreter.take(text):
            self._answer(wire, answer)
        if echo and after:
            self._echo(wire, echo, now + machine.options.reply_delay_ms)
        if self._interpreter.waiting and wire not in self._waiting:
            self._waiting = [wire]

    def tell_ready(self) -> None:
        """Answer the waits that have ended."""
        for text in self._interpreter.ready():
            for wire in self._waiting:
                self._answer(wire, text)

    def _echo(self, wire: Wire, data: bytes, now: float) -> None:
        self._send(wire, data.removesuffix(b"\n") + self._machine.options.echoed_end, now, echo=True)

    def _answer(self, wire: Wire, text: str) -> None:
        if self._log is not None:
            self._log.note("answer", ms=self._machine.now_ms, text=text)
        thought = self._machine.now_ms + self._machine.options.reply_delay_ms
        self._send(wire, text.encode("latin-1") + b"\r\n", thought)

    def _send(self, wire: Wire, data: bytes, now: float, echo: bool = False) -> None:
        for late, piece in self._injector.line.to_host(data, echo):
            wire.answer(piece, now, late)

    def log_violations(self) -> None:
        """Log the new violations."""
        new = self._machine.violated - self._logged_violations
        self._logged_violations += new
        if self._log is not None and new:
            for violation in list(self._machine.violations)[-new:]:
                self._log.note("violation", ms=violation.time_ms, text=violation.what)
