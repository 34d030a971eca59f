"""The emulated MARS-8: a thread that serves a pseudo-terminal or a TCP port in a clock's time.

Its requirements are in docs/sources.md, "Public clients". The thread sleeps while the arm is at rest and no bytes come.
With a `driver.line.stepped_clock.SteppedClock` there is no thread: the clock calls `Emulator.step`.
"""

from __future__ import annotations

import math
import os
import select
import threading
from pathlib import Path

from arm.controller.unit import Unit
from arm.errors import A465Error
from driver.emulator.apply_faults import FaultInjector
from driver.emulator.commands import Interpreter
from driver.emulator.exchange import Exchange
from driver.emulator.faults.model import Fault, FaultEvent
from driver.emulator.line.memory import MemoryLine, Tap
from driver.emulator.line.ports import Ports
from driver.emulator.options import EmulatorOptions
from driver.emulator.unit.machine import Machine
from driver.emulator.unit.plant import Plant
from driver.emulator.unit.record import Record, Violation
from driver.line.clock import Clock
from driver.line.signals import held
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog

_BATCH_WALL_S = 0.004  # wall time between two updates during a motion
_STEP_MS = 4  # between two updates in stepped time, while a client or a fault waits for the motion
_IDLE_STEP_MS = 100  # the same while nothing waits for it; a query updates the motion at once
_BATCH_MS = 20  # between two checks for R! while a client waits for it
_CLOSE_S = 5.0  # wall time that the thread has to end


class Emulator:
    """An emulated controller with an arm and a gripper. A context manager; runs in its own thread, or in stepped time.

    Its records are bounded by `EmulatorOptions.keep_lines` and `keep_ms`, so that a session may last for days.

    Args:
        unit: the arm and controller to emulate.
        clock: emulated time; share it with the driver.
        plant: what the gripper acts upon.
        options: behaviour, and scripted faults.
        log: records every line received and answered, every fault and violation, each with its emulated ``ms``.

    Attributes:
        failure: the error that ended the thread, or None.
    """

    def __init__(
        self,
        unit: Unit,
        clock: Clock,
        plant: Plant | None = None,
        options: EmulatorOptions | None = None,
        log: WireLog | None = None,
    ) -> None:
        self.clock = clock
        self.log = log
        self.failure: OSError | A465Error | None = None
        self.machine = Machine(unit, plant, options or EmulatorOptions())
        self.interpreter = Interpreter(self.machine)
        self._ports = Ports(self.machine.options, self._echoing)
        self._injector = FaultInjector(self.interpreter, self._ports, self._tell_fault)
        self._exchange = Exchange(self.interpreter, self._ports, self._injector, log)
        self._lock = threading.RLock()
        self._closing = False
        self._advancing = False
        self._spoken_to = False
        self._wake_read, self._wake_write = os.pipe()
        self.machine.now_ms = self._clock_ms()
        self._seen = (self.machine.now_ms, self.machine.true_counts())
        self._thread = threading.Thread(target=self._run, name="emulated MARS-8", daemon=True)
        if isinstance(clock, SteppedClock):
            clock.add(self)
        else:
            self._thread.start()

    def _echoing(self) -> bool:
        return self.interpreter.echo and not self._injector.switched_off

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- ports

    def open_pty(self, link: Path | None = None) -> str:
        """Serve a pseudo-terminal and return its path, which a driver opens. Clients may come and go.

        Args:
            link: symbolic link to create to it; removed on closing.

        Raises:
            InputError: `link` cannot be created.
        """
        self._require_thread()
        with self._lock:
            path = self._ports.open_pty(link)
        self._wake()
        return path

    def open_tcp(self, port: int = 0) -> str:
        """Serve a TCP port on the loopback (0: any free one) and return its URL, which a driver opens."""
        self._require_thread()
        with self._lock:
            url = self._ports.open_tcp(port)
        self._wake()
        return url

    def _require_thread(self) -> None:
        if isinstance(self.clock, SteppedClock):
            raise A465Error("a unit in stepped time has no thread to serve a port: use open_line()")

    def open_line(
        self, latency_s: float = 0.0, to_unit: Tap | None = None, to_host: Tap | None = None
    ) -> MemoryLine:
        """Return a line in memory, for a unit in stepped time; pass it to the driver as its port.

        Args:
            latency_s, to_unit, to_host: see `MemoryLine`.

        Raises:
            A465Error: the clock is not a stepped one.
        """
        if not isinstance(self.clock, SteppedClock):
            raise A465Error("a line in memory needs a driver.line.stepped_clock.SteppedClock")
        line = MemoryLine(self.clock, latency_s, to_unit, to_host)
        self._ports.open_line(line)
        return line

    def paths(self) -> tuple[str, ...]:
        """Return the paths of the pseudo-terminals; they change after `port_gone`."""
        with self._lock:
            return self._ports.paths()

    def close(self) -> None:
        """Stop serving. Records stay readable."""
        if self._closing:
            return
        self._closing = True
        if isinstance(self.clock, SteppedClock):
            self.clock.remove(self)
        else:
            self._wake()
            self._thread.join(_CLOSE_S)
        self._ports.close()
        for descriptor in (self._wake_read, self._wake_write):
            os.close(descriptor)

    # -- state for tests and cameras, from any thread

    def now_ms(self) -> int:
        """Return the emulated time up to which everything is executed."""
        self._catch_up()
        return self._seen[0]

    def counts(self) -> tuple[int, ...]:
        """Return the true position of the arm in the homed convention, also before homing."""
        self._catch_up()
        return self._seen[1]

    def last_motion(self) -> tuple[int, tuple[int, ...]]:
        """Return the emulated ms of the arm's last motion and the sign of each axis's, in counts; zeros before any."""
        return self.machine.recorder.last_motion()

    def record(self, after_ms: int = -1) -> Record:
        """Return the position at every executed ms after `after_ms` in which the arm moved, so far."""
        self._catch_up()
        return self.machine.recorder.record(after_ms)

    def _catch_up(self) -> None:
        """Execute the motion up to now; in stepped time this is done on demand."""
        if isinstance(self.clock, SteppedClock) and not self._closing:
            with self._lock, held():
                self._advance(self._clock_ms())

    @property
    def violations(self) -> tuple[Violation, ...]:
        """Commands so far that a correct driver never sends."""
        with self._lock:
            return tuple(self.machine.violations)

    @property
    def lines(self) -> tuple[tuple[int, str], ...]:
        """Lines received: emulated ms and text."""
        with self._lock:
            return tuple(self.interpreter.lines)

    @property
    def ignored(self) -> tuple[tuple[int, str], ...]:
        """Lines that were not understood: emulated ms and text."""
        with self._lock:
            return tuple(self.interpreter.ignored)

    @property
    def faults(self) -> tuple[FaultEvent, ...]:
        """Beginnings and ends of faults."""
        with self._lock:
            return tuple(self._injector.events)

    # -- faults

    def inject(self, fault: Fault) -> None:
        """Cause a fault: at once, `When.after_ms` from now, or at a future line or segment.

        An immediate fault has happened when this returns, except ``port_gone``, which takes some milliseconds.
        """
        with self._lock:
            self._advance(self._clock_ms())
            self._injector.schedule.inject(fault, self.machine.now_ms)
            self._injector.watch_segments()
            self._injector.apply_due(self.machine.now_ms)
        self._wake()

    def set_power(self, on: bool) -> None:
        """Switch arm power. Without it the brakes hold at once."""
        self._switch(Fault("power_off"), over=on)

    def set_motion_stop(self, pressed: bool) -> None:
        """Press or release the motion stop (red button)."""
        self._switch(Fault("motion_stop"), over=not pressed)

    def fail_axis(self, axis: str) -> None:
        """Put an axis into error, until PURGE."""
        self._switch(Fault("axis_error", axis=axis), over=False)

    def _switch(self, fault: Fault, over: bool) -> None:
        with self._lock:
            self._advance(self._clock_ms())
            self._injector.apply(fault, over)
        self._wake()

    def _tell_fault(self, event: FaultEvent) -> None:
        if self.log is not None:
            self.log.note("fault", ms=event.time_ms, fault=event.kind, over=event.over)

    # -- the thread

    def _clock_ms(self) -> int:
        return int(self.clock.now() * 1e3 + 1e-6)  # 1.001 s is 1001 ms in spite of rounding

    def _wake(self) -> None:
        if not isinstance(self.clock, SteppedClock):
            os.write(self._wake_write, b"x")
        elif not self._advancing:  # otherwise the present step does this at its end
            self._injector.serve_ports()

    def _run(self) -> None:
        try:
            while not self._closing:
                self._wait()
                self.step()
        except (OSError, A465Error) as error:
            self.failure = error

    def step(self) -> None:
        """Do what is due: read, move, execute lines, answer. Called by the thread, or by a stepped clock."""
        with self._lock:
            self._injector.serve_ports()  # requested by another thread
            now = self._clock_ms()
            self._ports.accept()
            self._read(now)
            self._advance(now)
            self._injector.serve_ports()

    def next_at(self) -> float:
        """Return the next time `step` is due in stepped time, s; infinite while it waits for bytes."""
        now, wires = self._clock_ms(), self._ports.wires
        if any(w.waiting() and not w.gone and not w.cut and w.wants_bytes(now) for w in wires):
            return now / 1e3
        due = self._due_ms(now)
        if self._moving:
            awaited = self.interpreter.waiting or math.isfinite(self.machine.halt_at_segment)
            due = min(due, self._seen[0] + (_STEP_MS if awaited else _IDLE_STEP_MS))
        return math.ceil(due) / 1e3 if math.isfinite(due) else due

    @property
    def _moving(self) -> bool:
        return self.machine.busy or self.machine.following.active

    def _due_ms(self, now: float) -> float:
        """Emulated ms at which a line is complete, an answer is sent, a fault is due, or there is room for bytes."""
        wires = self._ports.wires
        due = [t for w in wires for t in (w.next_line_at(), w.next_answer_at()) if t is not None]
        due += [w.room_at() for w in wires if not w.gone and not w.wants_bytes(now)]
        return min(*due, self._injector.schedule.next_at(), math.inf)

    def _wait(self) -> None:
        """Wait until something arrives or is due."""
        with self._lock:
            now, wires = self.clock.now() * 1e3, self._ports.wires
            due = self._due_ms(now)
            listen = [w.descriptor for w in wires if not w.gone and not w.cut and w.wants_bytes(now)]
            listen += [listener.fileno() for listener in self._ports.listeners] + [self._wake_read]
            timeout = _BATCH_WALL_S if self._moving else None
        if math.isfinite(due):
            soon = max(self.clock.wall((math.ceil(due) - now) / 1e3), 0.0)
            timeout = soon if timeout is None else min(soon, timeout)
        ready, _, _ = select.select(listen, [], [], timeout)
        if self._wake_read in ready:
            os.read(self._wake_read, 64)

    def _read(self, now: int) -> None:
        for wire in list(self._ports.wires):
            if not wire.gone and wire.wants_bytes(now) and not wire.receive(now):
                wire.gone = True  # what it sent before is still executed
            if wire.heard and not self._spoken_to:
                self._spoken_to = True
                self._injector.schedule.first_byte(now)
            if wire.gone and wire.next_line_at() is None:
                self._ports.drop(wire)

    def _advance(self, now: int) -> None:
        """Execute motion, lines, ends of waits and faults up to `now`, in the order of time."""
        if self._advancing:  # the plant has injected a fault
            return
        self._advancing = True
        try:
            self._execute(now)
        finally:
            self._advancing = False

    def _execute(self, now: int) -> None:
        machine, injector = self.machine, self._injector
        while True:
            injector.watch_segments()
            wire, line_at = self._exchange.next_line()
            fault_at = injector.schedule.next_at()
            self._move(min(now, line_at, math.ceil(fault_at) if fault_at < now else now))
            if machine.path.begun >= machine.halt_at_segment:
                continue
            if fault_at <= machine.now_ms:
                injector.apply_due(machine.now_ms)
            elif wire is not None and line_at <= now:
                self._exchange.arrive(wire)
            else:
                break
        self._exchange.tell_ready()
        self._seen = (machine.now_ms, machine.true_counts())  # before clients learn that the motion has ended
        self._exchange.log_violations()
        for each in self._ports.wires:
            each.flush(now)

    def _move(self, until: float) -> None:
        """Execute motion up to a time, or to the segment that triggers a fault."""
        machine = self.machine
        while machine.now_ms < until and machine.path.begun < machine.halt_at_segment:
            left = int(until) - machine.now_ms
            machine.run(min(left, _BATCH_MS) if self.interpreter.waiting and machine.busy else left)
            self._exchange.tell_ready()
