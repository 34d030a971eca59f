"""Another controller and its session: rows of times and joint positions over a socket, instead of a MARS-8.

It moves straight between rows. A question is a line `number WHO`, `AT`, `ROWS rows`, `GO digest` or `STOP`, and an
answer begins with its number. A motion is loaded at rest, and begins only with the digest of what arrived: what moves
is what was sent, and the line is free for STOP. `11_another_controller.py` executes a certified plan on it.
"""

import queue
import socket
import struct
import threading
from bisect import bisect_right
from collections.abc import Sequence
from contextlib import suppress
from hashlib import sha256
from typing import NamedTuple

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import Aborted, ExecutionStopped, ImpossibleError, InputError, LinkLost, NoAnswer
from driver.execution.control import Control
from driver.execution.controller import Jaws
from driver.execution.execute import OnProgress
from driver.execution.guard import Guarded
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.execution.rest import RestState, refuse_elsewhere, refuse_not_arrived, refuse_path_outside
from driver.execution.speed_override import stretched
from driver.line.clock import Clock
from driver.line.signals import held

NAME = "rows 1"
ANSWER_S, STALL_S, POLL_S = 2.0, 5.0, 0.05  # of an answer, beyond a motion's duration, between polls


class RowsServer(threading.Thread):
    """The controller with its arm at `q`, on a port of this computer. It stops when its client is gone."""

    def __init__(self, q: Sequence[float], clock: Clock) -> None:
        super().__init__(daemon=True)
        self.clock, self.fault, self.heard = clock, False, list[str]()
        self.rows = self.loaded = np.array([[0.0, *q]])
        self.began, self.digest = -np.inf, ""
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.address: tuple[str, int] = self.socket.getsockname()
        self.start()

    def run(self) -> None:
        with self.socket, suppress(OSError):  # closed
            while True:
                client, _ = self.socket.accept()
                with suppress(OSError, ValueError), client, client.makefile("rw") as lines:
                    for number, name, *rest in map(str.split, lines):
                        self.heard.append(name)
                        lines.write(f"{number} {self.answer(name, *rest)}\n")
                        lines.flush()
                self.answer("STOP")

    def close(self) -> None:
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self.join()

    def answer(self, name: str, text: str = "") -> str:
        end, t = float(self.rows[-1, 0]), self.clock.now() - self.began
        moving, t = t < end, min(t, end)
        q = [float(np.interp(t, self.rows[:, 0], column)) for column in self.rows.T[1:]]
        if name == "AT":
            return " ".join(["fault" if self.fault else "moving" if moving else "rest", *map(repr, [t, *q])])
        if name == "STOP":  # a heavier arm would brake on its path
            self.rows, self.digest = np.array([[0.0, *q]]), ""
        if name == "ROWS":
            self.digest = sha256(text.encode()).hexdigest()
            self.loaded = np.array([row.split(",") for row in text.split(";")], dtype=float)
            return self.digest
        if name == "GO" and text == self.digest and not (moving or self.fault):
            self.rows, self.began, self.digest = self.loaded, self.clock.now(), ""
            return "begun"
        return {"WHO": NAME, "STOP": "stopped"}.get(name, "refused")


class At(NamedTuple):
    """A sample: what the unit does, seconds and ms into its motion, and where the arm is."""

    state: str
    t: float
    time_ms: int
    counts: tuple[int, ...]


class RowsController(Guarded):
    """The session with it: a `driver.execution.controller.Controller`, whose docstrings hold for its members."""

    identified = False

    def __init__(self, address: tuple[str, int], unit: Unit, clock: Clock) -> None:
        super().__init__(unit, clock)
        self._number, self._interrupted, self._stopping = 0, False, False
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()  # "": woken, None: the line is lost
        try:
            self._socket = socket.create_connection(address, ANSWER_S)
        except OSError as error:
            raise InputError(f"{address}: {error}; is the controller on?") from error
        self._socket.settimeout(None)
        most = struct.pack("ll", *divmod(round(1e6 * ANSWER_S), 10**6))  # s and us
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, most)
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        with suppress(OSError, ValueError), self._socket.makefile() as lines:
            for line in lines:
                self._lines.put(line)
        self._lines.put(None)

    def _next(self, until: float) -> str:
        """Return the next line; "" if woken, or at `until`."""
        try:
            line = self.clock.next_of(self._lines, until)
        except queue.Empty:
            line = ""
        if self._interrupted and not self._stopping:
            raise Aborted("aborted on request", reason="aborted")
        if line is None:
            self._lines.put(None)
            raise LinkLost("the other side has closed the line", reason="link")
        return line

    def _ask(self, words: str) -> str:
        if not self.identified and words != "WHO":
            raise InputError(f"{words[:4]} not sent: the other side is not identified; call identify()")
        self._number += 1
        try:
            with held():  # no signal cuts a line
                self._socket.sendall(f"{self._number} {words}\n".encode())
        except OSError as error:
            raise LinkLost(f"the line is lost: {error}", reason="link") from error
        deadline = self.clock.now() + self.clock.patience(ANSWER_S)
        number, line = f"{self._number} ", ""
        while not line.startswith(number):  # else it answers an earlier question
            if self.clock.now() >= deadline:
                raise NoAnswer(f"no answer to {words[:4]} within {ANSWER_S:g} s", reason="silent")
            line = self._next(deadline)
        if (answer := line.removeprefix(number).strip()) == "refused":
            raise ExecutionStopped(f"{words[:4]} refused by the unit", reason="refused")
        return answer

    def identify(self) -> None:
        try:
            found = self._ask("WHO")
        except ExecutionStopped as error:
            raise InputError(f"the other side does not identify itself: {error}") from error
        if found != NAME:
            raise InputError(f"the other side is {found!r}, must be {NAME!r}")
        self.identified = True

    def _at(self) -> At:
        state, *numbers = self._ask("AT").split()
        t, *q = map(float, numbers)
        return At(state, t, round(1e3 * t), tuple(self.unit.counts(q).tolist()))

    def counts(self) -> tuple[int, ...]:
        return self._at().counts

    def require_well(self, what: str) -> None:
        if self._at().state == "fault":
            raise ExecutionStopped(f"{what}: the unit reports a fault", reason="fault")

    def gripper(self, fraction_closed: float) -> Jaws:
        raise InputError("the arm carries no gripper", value=fraction_closed)

    def wait_until(self, until: float) -> None:
        while self.clock.now() < until and self._next(until):
            pass

    def wake(self) -> None:
        self._lines.put("")

    def interrupt(self) -> None:
        self._interrupted = True
        self.wake()

    def close(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)  # ends the reader
        self._socket.close()

    def stop(self) -> RestState:
        self._stopping = True
        try:
            self._ask("STOP")
            return RestState(True, self.settled_counts(), stops=1)
        except (ExecutionStopped, InputError, KeyboardInterrupt) as error:
            return RestState(False, None, note=str(error) or "interrupted again after STOP was sent", stops=1)
        finally:
            self._stopping = self._interrupted = False

    def follow(
        self, path: CountPath, on_progress: OnProgress | None, options: StreamOptions | None, control: Control
    ) -> Sent:
        options, override = options or StreamOptions(), control.override  # every motion is preloaded
        if options.watch_jaws or any(len(segment.coefficients) != 1 for segment in path.segments):
            raise ImpossibleError(
                "the unit moves straight between rows, without jaws; certify rows, send these"
            )
        refuse_path_outside(self.unit, path)
        sent = stretched(path, override)
        times, lasts = sent.knot_times().tolist(), [segment.duration_ms / 1e3 for segment in sent.segments]
        rows = np.column_stack([times, self.unit.positions(sent.knots())]).tolist()
        text = ";".join(",".join(map(repr, row)) for row in rows)
        digest, samples = sha256(text.encode()).hexdigest(), 0
        with control.attached(self), self.guarded("rows"):
            refuse_elsewhere(self.unit, self.settled_counts(), path.start)
            self._ask(f"ROWS {text}")
            self._ask(f"GO {digest}")  # refused unless all arrived as it was sent
            start, at = self.clock.now(), self._at()
            while at.state == "moving":
                if np.abs(sent.at([at.t])[0] - at.counts).max() > options.following_counts:
                    raise ExecutionStopped(
                        "the arm is off its path", counts=list(at.counts), reason="following"
                    )
                if self.clock.now() > start + self.clock.patience(sent.duration_s + STALL_S):
                    raise NoAnswer("the motion has not ended in time", reason="deadline")
                self.wait_until(self.clock.now() + POLL_S)
                self.require_well("the motion")
                at, samples = self._at(), samples + 1
                if on_progress is not None:
                    done = bisect_right(times, at.t) - 1
                    on_progress(Progress(done, len(lasts), times[done], at, override, None, lasts))
            end = self.settled_counts()
            refuse_not_arrived(self.unit, end, path.end)
        return Sent(sent, start, self.clock.now() - start, end, sent.duration_s, samples)
