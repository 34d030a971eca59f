"""Send lines to a port, receive lines from it, and follow the echo of each line sent.

Only the thread that uses a link writes to the port. The port's reader thread splits what it receives into lines and
passes them on through a queue. So there is no lock that an interrupt could leave held, and STOP can always be sent.
"""

from __future__ import annotations

import contextlib
import queue
import re
from collections import deque

from arm.errors import A465Error, Aborted, ExecutionStopped, LinkLost
from driver.line.clock import Clock
from driver.line.echo import EchoWatch, Mismatch
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

ANSWER_S = 2.0  # time limit of an answer
UNSENT_BYTES = 64  # a STOP waits behind at most this many bytes
CHUNK_BYTES = 32  # written at once
LONGEST_LINE = 1024  # bytes; more without a line end are noise
UNREAD_LINES = 1000  # received lines in the queue; further noise is dropped
UNREAD_ANSWERS = 10_000  # received lines in the queue; with more the other side is not a MARS
TURN_S = 0.2  # how long to wait for pending answers before sending, beyond the round trip
_STOP = f"\n{encode('STOP')}\n".encode()


class LineDamaged(ExecutionStopped):
    """The echo shows that a line did not arrive as sent. With ``sent``, ``received`` and ``column``."""


def line_damaged(text: str, mismatch: Mismatch) -> LineDamaged:
    """Return the error of a line whose echo differs, with the data of the mismatch."""
    return LineDamaged(
        text, sent=mismatch.sent, received=mismatch.received, column=mismatch.column, reason="line"
    )


class PortLink:
    """An open port to a controller.

    Until `identified` is set, only harmless lines (ECHO, STAMP, VER) can be sent, as the other side may not be a MARS.
    Not thread-safe.

    Args:
        port: a device such as ``/dev/mars``, a pseudo-terminal, or ``socket://host:port``; or an open port.
        clock: controller time, used for all deadlines.
        log: records every byte, if given.

    Attributes:
        events: received `Ready` and `Failed`, oldest first; the latest 64 are kept.
        echo: state of the echo of each line sent.
        echoes: whether the unit echoes (`driver.line.manners`); if not, damaged lines are not noticed here.
        takes_turns: whether the unit interleaves echoes and answers. Then nothing is sent while an answer is pending,
            and no query while an echo is.
        answer_trip_s: time from a query to its answer; used if the unit does not echo.
        restarted: the unit was switched off and on since it was identified, and has lost its positions.

    Raises:
        InputError: the port does not exist, is not a serial line, or is in use.
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
        self._put_off: deque[Reply] = deque()  # received while waiting to send
        if isinstance(port, str):
            port = SerialPort(port, clock.wall(self.patience(ANSWER_S)), None if log is None else log.path)
        self._port = port
        self.url = port.url
        self._splitter = LineSplitter(LONGEST_LINE)
        # received lines with their time of arrival, since they may be read later
        self._inbox: queue.SimpleQueue[tuple[Received, float] | LinkLost | None] = queue.SimpleQueue()
        self._lost: LinkLost | None = None
        self._interrupted = False
        self._line_free_at = clock.now()
        port.listen(self._arrived, self._gone)

    # -- time

    def patience(self, seconds: float) -> float:
        """As `Clock.patience`."""
        return self.clock.patience(seconds)

    def deadline(self, seconds: float) -> float:
        """Return the controller time `patience(seconds)` from now."""
        return self.clock.now() + self.patience(seconds)

    # -- requests of another thread or a signal handler

    def wake(self) -> None:
        """Make a waiting `receive` return now. May be called from anywhere: the queue's put is reentrant."""
        self._inbox.put(None)

    def interrupt(self) -> None:
        """Make the running or next `send` or `receive` raise `Aborted`, once. May be called from anywhere."""
        self._interrupted = True
        self.wake()

    def _heed(self) -> None:
        if self._interrupted:
            self._interrupted = False
            raise Aborted("aborted on request", reason="aborted")

    # -- writing

    def send(self, line: str) -> int:
        """Send one line in chunks, no faster than the baud rate. Return its number for `echo`.

        Raises:
            Aborted: `interrupt` was called; part of the line may be sent, `send_stop` ends it.
            LinkLost: the port is gone, or takes no bytes (a unit that is off holds CTS low).
            ExecutionStopped: the wire log cannot be written.
        """
        name = re.match("[A-Z0-9]*", line)
        if line and not self.identified and (name is None or name[0] not in HARMLESS):
            raise A465Error(f"{line!r} not sent: the unit on {self.url} is not identified", line=line)
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
        """Wait for pending answers and echoes, so that answers and echoes never come together."""
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
        """Time from a byte sent to its echo or answer, on an empty line, s."""
        return self.echo.round_trip_s if self.echoes else self.answer_trip_s

    @property
    def line_free_at(self) -> float:
        """When the last written byte leaves."""
        return max(self._line_free_at, self.clock.now())

    @property
    def blocked(self) -> bool:
        """Whether the unit takes no bytes at the moment."""
        return self._port.out_waiting >= UNSENT_BYTES

    @property
    def stop_delivery_s(self) -> float:
        """Longest time for a STOP to reach the unit, behind the bytes already written."""
        return (UNSENT_BYTES + len(_STOP)) / BYTES_PER_SECOND + self.trip_s / 2.0

    def send_stop(self, again: bool = False) -> None:
        """Send STOP ahead of everything else: drop unsent bytes and end a partial line.

        Does nothing if the unit is not identified: nothing can have been started there. Afterwards echoes are not
        checked until `synchronise` has succeeded.

        Args:
            again: STOP was sent a moment ago; keep what was written since.

        Raises:
            LinkLost: the port is gone.
        """
        self._interrupted = False
        if not self.identified:
            return
        if self.log is not None and self.log.failed:
            self.log = None  # already reported; stop without it
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
                why = f"{self.url}: takes no more bytes; is the unit on?"
                raise LinkLost(why, url=self.url, reason="blocked")
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
        """Return the next received line, or None at controller time `until` or on `wake`.

        `Ready` and `Failed` are also kept in `events`.

        Raises:
            Aborted: `interrupt` was called.
            LineDamaged: the echo of a motion line differs; raised at every call until `send_stop`.
            LinkLost: the port is gone and every line received before has been returned.
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
        if item is None:  # put by `wake`
            self._heed()
            return None
        if isinstance(item, LinkLost):
            self._lost = item
            raise item
        received, at_s = item
        rest = self.echo.take(received.text, at_s, received.torn)
        if (mismatch := self.echo.mismatch) is not None:
            raise line_damaged(mismatch.describe(), mismatch)
        if self.echo.mixed and self.echoes and not self.takes_turns:
            self.takes_turns = True
            if self.log is not None:
                self.log.note("takes_turns")
        if rest is None:
            return Echoed(received.text)
        reply = parse_reply(rest)
        if isinstance(reply, Ready | Failed):
            self.events.append(reply)
        return reply

    def _arrived(self, data: bytes) -> None:
        """Split received bytes into lines. Raises OSError, which ends the link, if too many lines are unread."""
        if self.log is not None:
            self.log.received(data)
        for line in self._splitter.take(data):
            if self._inbox.qsize() < UNREAD_LINES or not isinstance(parse_reply(line.text), Other):
                self._inbox.put((line, self.clock.now()))
        if self._inbox.qsize() > UNREAD_ANSWERS:
            raise OSError(f"flooded by more than {UNREAD_ANSWERS} unexpected lines")

    def _gone(self, error: OSError) -> None:
        self._inbox.put(LinkLost(f"{self.url}: the link is lost: {error}", url=self.url, reason="link"))

    def close(self) -> None:
        """Close the port. Unsent bytes are dropped."""
        self._port.close()
