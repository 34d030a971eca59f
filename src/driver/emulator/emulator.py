"""The emulated MARS-8: a thread that serves a pseudo-terminal or a TCP port in a clock's time.

Controller's fact sheet, section 4.3, is what it must do. Nothing runs while nothing moves and nobody speaks.
"""

from __future__ import annotations

import contextlib
import math
import os
import pty
import select
import socket
import threading
import tty
from pathlib import Path
from types import TracebackType

from arm.errors import A465Error
from arm.unit import Unit
from driver.clock import Clock
from driver.emulator.commands import Interpreter
from driver.emulator.machine import Machine, Plant
from driver.emulator.options import EmulatorOptions
from driver.emulator.record import Record, Violation
from driver.emulator.wire import Wire

_BATCH_WALL_S = 0.004  # how late, in wall time, motion and R! may be seen
_BATCH_MS = 20  # while somebody waits for R!, look this often
_CLOSE_S = 5.0


class Emulator:
    """An emulated controller with an arm and a gripper. A context manager; runs in its own thread.

    Args:
        unit: which arm and controller.
        clock: its time; share it with the driver.
        plant: what the gripper acts upon.
        options: behaviour.
    """

    def __init__(
        self, unit: Unit, clock: Clock, plant: Plant | None = None, options: EmulatorOptions | None = None
    ) -> None:
        self.clock = clock
        self.machine = Machine(unit, plant, options or EmulatorOptions())
        self.interpreter = Interpreter(self.machine)
        self._wires: list[Wire] = []
        self._sockets: dict[int, socket.socket] = {}
        self._listeners: list[socket.socket] = []
        self._slaves: list[int] = []
        self._links: list[Path] = []
        self._waiting: list[Wire] = []
        self._lock = threading.Lock()
        self._closing = False
        self._wake_read, self._wake_write = os.pipe()
        self.machine.now_ms = self._clock_ms()
        self._seen = (self.machine.now_ms, self.machine.true_counts())
        self._thread = threading.Thread(target=self._run, name="emulated MARS-8", daemon=True)
        self._thread.start()

    def __enter__(self) -> Emulator:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    # -- ports

    def open_pty(self, link: Path | None = None) -> str:
        """Serve a pseudo-terminal; the path that a driver opens. It survives any number of clients.

        Args:
            link: made a symbolic link to it, removed on closing.

        Raises:
            A465Error: `link` exists already.
        """
        master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        path = os.ttyname(slave)
        if link is not None:
            try:
                link.symlink_to(path)
            except OSError as error:
                os.close(master)
                os.close(slave)
                raise A465Error(f"{link}: cannot be made a link to {path}: {error.strerror}") from error
            self._links.append(link)
        with self._lock:
            self._slaves.append(slave)  # open for ever: else reading ends when a client leaves
            self._wires.append(Wire(master, self.machine.options.paced))
        self._wake()
        return path

    def open_tcp(self, port: int = 0) -> str:
        """Serve a TCP port of this machine alone (0: any free one); the URL that a driver opens."""
        listener = socket.create_server(("127.0.0.1", port))
        listener.setblocking(False)
        with self._lock:
            self._listeners.append(listener)
        self._wake()
        return f"socket://127.0.0.1:{listener.getsockname()[1]}"

    def close(self) -> None:
        """Stop serving; what was recorded stays readable."""
        if self._closing:
            return
        self._closing = True
        self._wake()
        self._thread.join(_CLOSE_S)
        for path in self._links:
            path.unlink(missing_ok=True)
        for connection in (*self._sockets.values(), *self._listeners):
            connection.close()
        for wire in self._wires:
            if wire.descriptor not in self._sockets:
                os.close(wire.descriptor)
        for descriptor in (*self._slaves, self._wake_read, self._wake_write):
            os.close(descriptor)

    # -- what a test or a camera may look at, from any thread

    def now_ms(self) -> int:
        """Emulated time up to which everything is executed."""
        return self._seen[0]

    def counts(self) -> tuple[int, ...]:
        """True position of the arm in the homed convention, also before homing."""
        return self._seen[1]

    def record(self) -> Record:
        """Every executed ms in which the arm moved, so far."""
        return self.machine.recorder.record()

    @property
    def violations(self) -> tuple[Violation, ...]:
        """What a careful driver never does, so far."""
        return tuple(self.machine.violations)

    @property
    def lines(self) -> tuple[tuple[int, str], ...]:
        """Every line received: emulated ms and text."""
        return tuple(self.interpreter.lines)

    @property
    def ignored(self) -> tuple[tuple[int, str], ...]:
        """Every line that was not understood: emulated ms and text."""
        return tuple(self.interpreter.ignored)

    # -- faults to order

    def set_power(self, on: bool) -> None:
        """Arm power; off makes the brakes hold at once."""
        with self._lock:
            self.machine.power = on
            self._fault()

    def set_motion_stop(self, pressed: bool) -> None:
        """The red button."""
        with self._lock:
            self.machine.motion_stop = pressed
            self._fault()

    def fail_axis(self, axis: str) -> None:
        """An axis goes into error, until PURGE."""
        with self._lock:
            self.machine.axis_errors.add(axis)
            self._fault()

    def _fault(self) -> None:
        if self.machine.faulty:
            self.machine.freeze()
        self._wake()

    # -- the thread

    def _clock_ms(self) -> int:
        return int(self.clock.now() * 1e3)

    def _wake(self) -> None:
        os.write(self._wake_write, b"x")

    def _run(self) -> None:
        while not self._closing:
            self._wait()
            with self._lock:
                now = self._clock_ms()
                self._accept()
                self._read(now)
                self._advance(now)

    def _wait(self) -> None:
        """Until something arrives, or is due; for ever if nothing is."""
        with self._lock:
            now = self.clock.now() * 1e3
            due = [t for w in self._wires for t in (w.next_line_at(), w.next_answer_at()) if t is not None]
            listen = [w.descriptor for w in self._wires if not w.gone and w.wants_bytes(now)]
            due += [w.room_at() for w in self._wires if not w.gone and not w.wants_bytes(now)]
            listen += [listener.fileno() for listener in self._listeners] + [self._wake_read]
            timeout = _BATCH_WALL_S if self.machine.busy else None
        if due:
            soon = max(self.clock.wall((math.ceil(min(due)) - now) / 1e3), 0.0)
            timeout = soon if timeout is None else min(soon, timeout)
        ready, _, _ = select.select(listen, [], [], timeout)
        if self._wake_read in ready:
            os.read(self._wake_read, 64)

    def _accept(self) -> None:
        for listener in self._listeners:
            with contextlib.suppress(BlockingIOError):
                connection, _ = listener.accept()
                connection.setblocking(False)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._sockets[connection.fileno()] = connection
                self._wires.append(Wire(connection.fileno(), self.machine.options.paced))

    def _read(self, now: int) -> None:
        for wire in list(self._wires):
            if not wire.gone and wire.wants_bytes(now) and not wire.receive(now):
                wire.gone = True  # what it sent before is still obeyed
            if wire.gone and wire.next_line_at() is None:
                self._wires.remove(wire)
                self._sockets.pop(wire.descriptor).close()

    def _advance(self, now: int) -> None:
        """Execute everything up to `now`, in order: motion, complete lines, ends of waits."""
        machine = self.machine
        while True:
            wire, due = self._next_line()
            until = min(now, due)
            while machine.now_ms < until:
                left = until - machine.now_ms
                machine.run(min(left, _BATCH_MS) if self.interpreter.waiting and machine.busy else left)
                self._tell_ready()
            if wire is None or due > now:
                break
            self._obey(wire, wire.take_line())
        self._tell_ready()
        self._seen = (machine.now_ms, machine.true_counts())  # before anybody learns that it has ended
        for wire in self._wires:
            wire.flush(now)

    def _next_line(self) -> tuple[Wire | None, int]:
        first: Wire | None = None
        due = math.inf
        for wire in self._wires:
            at = wire.next_line_at()
            if at is not None and at < due:
                first, due = wire, at
        return first, math.ceil(due) if first is not None else 2**62

    def _obey(self, wire: Wire, data: bytes) -> None:
        machine, now = self.machine, self.machine.now_ms
        if wire.fresh:
            wire.fresh = False
            if machine.options.noise:
                wire.answer(machine.options.noise, now)
        if self.interpreter.echo:
            wire.answer(data, now)
        for text in self.interpreter.take(data.decode("latin-1")):
            self._answer(wire, text)
        if self.interpreter.waiting and wire not in self._waiting:
            self._waiting = [wire]

    def _tell_ready(self) -> None:
        for text in self.interpreter.ready():
            for wire in self._waiting:
                self._answer(wire, text)

    def _answer(self, wire: Wire, text: str) -> None:
        thought = self.machine.now_ms + self.machine.options.reply_delay_ms
        wire.answer(text.encode("latin-1") + b"\r\n", thought)
