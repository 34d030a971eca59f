"""Lines to and from a port: one writer, a port that delivers what arrives, each line's echo followed.

The thread that uses a link is the only one that writes; the port's reader thread only splits lines and hands them
over through a queue. So no lock exists that an interrupt could leave behind, and a stop can always be sent.
"""

from __future__ import annotations

import contextlib
import queue
import re
from collections import deque
from dataclasses import dataclass

from arm.errors import A465Error, ExecutionStopped
from driver.line.clock import Clock
from driver.line.echo import EchoWatch
from driver.line.port import PORT_ERRORS, Port, SerialPort
from driver.line.protocol import (
    BYTES_PER_SECOND,
    HARMLESS,
    Echoed,
    Failed,
    Other,
    Ready,
    Reply,
    encode,
    parse_reply,
)
from driver.line.splitter import LineSplitter, Received
from driver.line.unit_time import UnitTime
from driver.line.wire_log import WireLog

ANSWER_S = 2.0  # an answer comes within this, or never
LEAST_WALL_S = 1.0  # a busy host may sleep this long, whatever the controller's time scale
UNSENT_BYTES = 64  # never more are on their way, so that a stop is never behind more
CHUNK_BYTES = 32
LONGEST_LINE = 1024  # received without a line end: noise
UNREAD_LINES = 1000  # noise beyond this is dropped if nobody reads
TURN_S = 0.2  # beyond the round trip, for an answer to be said
_STOP = f"\n{encode('STOP')}\n".encode()
UNREAD_ANSWERS = 10_000  # a unit that sends more lines than that which nobody asked for is no MARS


class NoAnswer(ExecutionStopped):
    """The controller did not answer in time."""


class LinkLost(ExecutionStopped):
    """The port is gone."""


class LineDamaged(ExecutionStopped):
    """A line did not arrive as it was sent: the unit's echo tells. With ``sent``, ``received`` and ``column``."""


class Aborted(ExecutionStopped):
    """Whoever drives the arm was asked to end at once (`driver.execution.control.Control`)."""


@dataclass(frozen=True)
class _Line:
    """A received line without its end, and when it came: whoever reads it may be late."""

    received: Received
    at_s: float


@dataclass(frozen=True)
class _Wake:
    """Put among the received lines, so that a waiting thread looks up."""


class PortLink:
    """An open port to a controller.

    Until `identified` is set, only harmless lines (ECHO, STAMP, VER) can be sent: what is on the other side may not
    be a MARS at all. Not for use from two threads.

    Args:
        port: a device such as ``/dev/mars``, a pseudo-terminal, or ``socket://host:port``; or a port that is open.
        clock: the controller's time; all deadlines are in it.
        log: takes every byte, if given.

    Attributes:
        events: received `Ready` and `Failed`, oldest first; the newest 64 are kept.
        echo: what of the lines sent has come back.
        echoes: the unit sends back what it receives (`driver.line.manners`); without, damaged lines are not
            noticed here.
        takes_turns: nothing is sent while an answer is to come, and no query while an echo is: the unit mixes them.
        answer_trip_s: from a question to its answer, of a unit that does not echo.
        restarted: the unit was switched off and on since it was identified, and has lost its positions.

    Raises:
        InputError: the port is not there, is no serial line, or is in use.
    """

    def __init__(self, port: str | Port, clock: Clock, log: WireLog | None = None) -> None:
        self.clock = clock
        self.log = log
        self.identified = False
        self.events: deque[Ready | Failed] = deque(maxlen=64)
        self.restarted = False
        self.echo = EchoWatch()
        self.echoes = False
        self.takes_turns = False
        self.answer_trip_s = 0.0
        self.unit_time = UnitTime()
        self._put_off: deque[Reply] = deque()  # received while a turn was waited for
        if isinstance(port, str):
            port = SerialPort(port, write_timeout_s=clock.wall(self.patience(ANSWER_S)))
        self._port = port
        self.url = port.url
        self._splitter = LineSplitter(LONGEST_LINE)
        self._inbox: queue.SimpleQueue[_Line | LinkLost | _Wake] = queue.SimpleQueue()
        self._lost: LinkLost | None = None
        self._interrupted = False
        self._line_free_at = clock.now()
        port.listen(self._arrived, self._gone)

    # -- time

    def patience(self, seconds: float) -> float:
        """That many controller seconds, but never less than LEAST_WALL_S of wall time: the host may be busy."""
        return self.clock.at_least(seconds, LEAST_WALL_S)

    def deadline(self, seconds: float) -> float:
        """The controller time when `patience(seconds)` from now is over."""
        return self.clock.now() + self.patience(seconds)

    # -- requests of another thread or a signal handler

    def wake(self) -> None:
        """Let a waiting `receive` return now. May be called from anywhere: the queue's put is reentrant."""
        self._inbox.put(_Wake())

    def interrupt(self) -> None:
        """Let `send` or `receive`, running or next, raise `Aborted` once. May be called from anywhere."""
        self._interrupted = True
        self.wake()

    def _heed(self) -> None:
        if self._interrupted:
            self._interrupted = False
            raise Aborted("aborted on request", reason="aborted")

    # -- writing

    def send(self, line: str) -> int:
        """Send one line, in pieces, as fast as the line carries them and no faster; its number for `echo`.

        Raises:
            Aborted: `interrupt` was called; a piece of the line may have gone, `send_stop` ends it.
            LinkLost: the port is gone, or takes no bytes (a unit that is off holds CTS low).
            ExecutionStopped: the wire log cannot be written.
        """
        name = re.match("[A-Z0-9]*", line)
        if line and not self.identified and (name is None or name[0] not in HARMLESS):
            raise A465Error(f"{line!r} refused: the unit on {self.url} has not identified itself", line=line)
        if self.log is not None:
            self.log.check()
        if self.takes_turns:
            self._await_turn(line)
        data = line.encode("ascii") + b"\n"
        for begin in range(0, len(data), CHUNK_BYTES):
            chunk = data[begin : begin + CHUNK_BYTES]
            self._await_room(len(chunk))
            self._heed()
            self._write(chunk)
        return self.echo.sent(line, self._line_free_at)

    def _await_turn(self, line: str) -> None:
        """Let the unit say what it has to, so that answers and echoes are never on their way together."""
        asks = line.endswith("?") or line.startswith("STAMP:")
        deadline = self.clock.now() + self.clock.at_least(2.0 * self.trip_s + TURN_S, TURN_S)
        while self.echo.unanswered or (asks and self.echo.unechoed_bytes):
            reply = self._next(deadline)
            if reply is not None:
                self._put_off.append(reply)
            elif self.clock.now() >= deadline:
                self.echo.forgive_answers()
                return

    @property
    def trip_s(self) -> float:
        """From a byte sent to what it brings back, on an empty line, s."""
        return self.echo.round_trip_s if self.echoes else self.answer_trip_s

    @property
    def line_free_at(self) -> float:
        """When the last byte that was written leaves."""
        return max(self._line_free_at, self.clock.now())

    @property
    def blocked(self) -> bool:
        """The unit takes no bytes at the moment."""
        return self._port.out_waiting >= UNSENT_BYTES

    @property
    def stop_delivery_s(self) -> float:
        """How long a STOP takes to the unit, at most: behind what was written before, and as long as an echo."""
        return (UNSENT_BYTES + len(_STOP)) / BYTES_PER_SECOND + self.trip_s / 2.0

    def send_stop(self, again: bool = False) -> None:
        """Send STOP before anything else: what the system still holds back is dropped, half a line is ended.

        Does nothing on a unit that has not identified itself: nothing can have been started there. From here on no echo
        is judged until `synchronise` has succeeded.

        Args:
            again: it was sent a moment before; what was written since is not dropped.

        Raises:
            LinkLost: the port is gone.
        """
        self._interrupted = False  # this is what it asked for
        if not self.identified:
            return
        if self.log is not None and self.log.failed:
            self.log = None  # that has been told; stopping goes on without
        if not again:
            self.echo.forget()
            self._put_off.clear()
            with contextlib.suppress(*PORT_ERRORS):
                self._port.reset_output_buffer()
        self._write(_STOP)
        self.echo.sent(encode("STOP"), self._line_free_at)

    def _await_room(self, size: int) -> None:
        deadline = self.deadline(ANSWER_S)
        while (excess := self._unsent_bytes() + size - UNSENT_BYTES) > 0.0:
            if self.clock.now() > deadline:
                raise LinkLost(
                    f"{self.url}: takes no more bytes; is the unit on?", url=self.url, reason="blocked"
                )
            self.clock.sleep(excess / BYTES_PER_SECOND)

    def _unsent_bytes(self) -> float:
        modelled = (self._line_free_at - self.clock.now()) * BYTES_PER_SECOND
        return max(modelled, float(self._port.out_waiting), 0.0)

    def _write(self, data: bytes) -> None:
        if self._lost is not None:
            raise self._lost
        if self.log is not None:
            self.log.sent(data)
        self._line_free_at = max(self._line_free_at, self.clock.now()) + len(data) / BYTES_PER_SECOND
        try:
            self._port.write(data)
        except PORT_ERRORS as error:
            self._lost = LinkLost(f"{self.url}: the link is lost: {error}", url=self.url, reason="link")
            raise self._lost from error

    # -- reading

    def receive(self, until: float) -> Reply | None:
        """The next received line, or None when controller time `until` has come, or before that on `wake`.

        `Ready` and `Failed` are also kept in `events`.

        Raises:
            Aborted: `interrupt` was called.
            LineDamaged: a motion line did not come back as it was sent; so at every call until `send_stop`.
            LinkLost: the port is gone and every line received before has been handed out.
        """
        return self._put_off.popleft() if self._put_off else self._next(until)

    def _next(self, until: float) -> Reply | None:
        self._heed()
        try:
            item = self.clock.next_of(self._inbox, until)
        except queue.Empty:
            if self._lost is not None:
                raise self._lost from None
            return None
        if isinstance(item, _Wake):
            self._heed()
            return None
        if isinstance(item, LinkLost):
            self._lost = item
            raise item
        rest = self.echo.take(item.received.text, item.at_s, item.received.torn)
        if (mismatch := self.echo.mismatch) is not None:
            raise LineDamaged(
                mismatch.describe(),
                sent=mismatch.sent,
                received=mismatch.received,
                column=mismatch.column,
                reason="line",
            )
        if self.echo.mixed and self.echoes and not self.takes_turns:
            self.takes_turns = True
            if self.log is not None:
                self.log.note("takes_turns")
        if rest is None:
            return Echoed(item.received.text)
        reply = parse_reply(rest)
        if isinstance(reply, Ready | Failed):
            self.events.append(reply)
        return reply

    def _arrived(self, data: bytes) -> None:
        """What the port delivers: bytes to lines. Raises OSError when flooded, which ends the link."""
        if self.log is not None:
            self.log.received(data)
        for line in self._splitter.take(data):
            self._hand_over(line)
        if self._inbox.qsize() > UNREAD_ANSWERS:
            raise OSError(f"more than {UNREAD_ANSWERS} lines that nobody asked for")

    def _gone(self, error: OSError) -> None:
        self._inbox.put(LinkLost(f"{self.url}: the link is lost: {error}", url=self.url, reason="link"))

    def _hand_over(self, line: Received) -> None:
        if self._inbox.qsize() < UNREAD_LINES or not isinstance(parse_reply(line.text), Other):
            self._inbox.put(_Line(line, self.clock.now()))

    def close(self) -> None:
        """Close the port. Whatever is still unsent is dropped."""
        self._port.close()
