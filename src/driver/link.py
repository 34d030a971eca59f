"""A line-by-line link to a controller: one writer, a port that delivers what arrives, a deadline on every wait.

The thread that uses a `Link` is the only one that writes; the port's reader thread only splits lines and hands them
over through a queue. So no lock exists that an interrupt could leave behind, and a stop can always be sent.
"""

from __future__ import annotations

import contextlib
import queue
import re
from collections import deque
from dataclasses import dataclass

from arm.errors import A465Error, ExecutionStopped
from driver.clock import Clock
from driver.port import PORT_ERRORS, Port, SerialPort
from driver.protocol import (
    BYTES_PER_SECOND,
    HARMLESS,
    STAMP_RANGE,
    Answer,
    Failed,
    Other,
    Ready,
    Reply,
    encode,
    encode_query,
    parse_reply,
)
from driver.wirelog import WireLog

ANSWER_S = 2.0  # an answer comes within this, or never
LEAST_WALL_S = 1.0  # a busy host may sleep this long, whatever the controller's time scale
UNSENT_BYTES = 64  # never more are on their way, so that a stop is never behind more
CHUNK_BYTES = 32
LONGEST_LINE = 1024  # received without a line end: noise
UNREAD_LINES = 1000  # noise beyond this is dropped if nobody reads
UNREAD_ANSWERS = 10_000  # a unit that sends more lines than that which nobody asked for is no MARS


class NoAnswer(ExecutionStopped):
    """The controller did not answer in time."""


class LinkLost(ExecutionStopped):
    """The port is gone."""


class Aborted(ExecutionStopped):
    """Whoever drives the arm was asked to end at once (`driver.control.Control`)."""


@dataclass(frozen=True)
class _Wake:
    """Put among the received lines, so that a waiting thread looks up."""


class Link:
    """An open port to a controller.

    Until `identified` is set, only harmless lines (ECHO, STAMP, VER) can be sent: what is on the other side may not
    be a MARS at all. Not for use from two threads.

    Args:
        port: a device such as ``/dev/mars``, a pseudo-terminal, or ``socket://host:port``; or a port that is open.
        clock: the controller's time; all deadlines are in it.
        log: takes every byte, if given.

    Attributes:
        events: received `Ready` and `Failed`, oldest first; the newest 64 are kept.
        restarted: a line came back as an echo after the unit was identified and told not to: it was switched off and
            on since, and has lost its positions.

    Raises:
        InputError: the port is not there, is no serial line, or is in use.
    """

    def __init__(self, port: str | Port, clock: Clock, log: WireLog | None = None) -> None:
        self.clock = clock
        self.log = log
        self.identified = False
        self.events: deque[Ready | Failed] = deque(maxlen=64)
        self.restarted = False
        self._recent: deque[str] = deque(maxlen=8)  # lines sent since the unit was identified
        if isinstance(port, str):
            port = SerialPort(port, write_timeout_s=clock.wall(self.patience(ANSWER_S)))
        self._port = port
        self.url = port.url
        self._rest = b""  # of a received line that is not complete
        self._inbox: queue.SimpleQueue[Reply | LinkLost | _Wake] = queue.SimpleQueue()
        self._lost: LinkLost | None = None
        self._interrupted = False
        self._stamp = clock.unique_ms() % STAMP_RANGE  # a stale answer of an earlier user differs
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

    def send(self, line: str) -> None:
        """Send one line, in pieces, as fast as the line carries them and no faster.

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
        if line and self.identified:
            self._recent.append(line)
        data = line.encode("ascii") + b"\n"
        for begin in range(0, len(data), CHUNK_BYTES):
            chunk = data[begin : begin + CHUNK_BYTES]
            self._await_room(len(chunk))
            self._heed()
            self._write(chunk)

    def send_stop(self) -> None:
        """Send STOP before anything else: what the system still holds back is dropped, half a line is ended.

        Does nothing on a unit that has not identified itself: nothing can have been started there.

        Raises:
            LinkLost: the port is gone.
        """
        self._interrupted = False  # this is what it asked for
        if not self.identified:
            return
        if self.log is not None and self.log.failed:
            self.log = None  # that has been told; stopping goes on without
        with contextlib.suppress(*PORT_ERRORS):
            self._port.reset_output_buffer()
        self._write(f"\n{encode('STOP')}\n".encode())

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
            LinkLost: the port is gone and every line received before has been handed out.
        """
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
        if isinstance(item, Ready | Failed):
            self.events.append(item)
        if isinstance(item, Other) and item.text in self._recent:
            self.restarted = True
        return item

    def wait(self, seconds: float) -> None:
        """Let that many controller seconds pass; what is received meanwhile is dropped, `events` kept.

        Raises:
            Aborted, LinkLost: at once, as `receive`.
        """
        until = self.clock.now() + seconds
        while self.clock.now() < until:
            self.receive(until)

    def await_answer(self, key: str, timeout: float = ANSWER_S) -> str:
        """The text of the next answer with that key; other lines are passed over, `events` kept.

        Raises:
            NoAnswer: none came in `timeout` controller seconds.
            LinkLost: the port is gone.
        """
        deadline = self.deadline(timeout)
        while True:
            reply = self.receive(deadline)
            if isinstance(reply, Answer) and reply.key == key:
                return reply.text
            if reply is None and self.clock.now() >= deadline:
                raise NoAnswer(
                    f"{self.url}: no answer {key} within {timeout:g} s",
                    url=self.url,
                    key=key,
                    reason="silent",
                )

    def ask(self, name: str, axis: str = "", timeout: float = ANSWER_S) -> str:
        """The answer to ``NAMEaxis?``.

        Raises:
            NoAnswer: none came in time.
            LinkLost: the port is gone.
        """
        self.send(encode_query(name, axis))
        return self.await_answer(name + axis, timeout)

    def ask_optional(self, name: str, axis: str = "") -> str | None:
        """The answer to a query that the unit may not know; None if it answers the stamp behind it only.

        Raises:
            NoAnswer, LinkLost: as `synchronise`.
        """
        self.send(encode_query(name, axis))
        found: list[str] = []
        self._stamp_round(ANSWER_S, name + axis, found)
        return found[-1] if found else None

    def synchronise(self, timeout: float = ANSWER_S, attempts: int = 1) -> None:
        """Wait until the unit has parsed every line sent so far, by a fresh stamp.

        Afterwards no earlier answer is still on its way.

        Args:
            timeout: of each attempt, controller seconds.
            attempts: how many stamps to try; more than one only where noise is expected (power-up, after a stop).

        Raises:
            NoAnswer: no stamp came back.
            LinkLost: the port is gone.
        """
        for attempt in range(1, attempts + 1):
            try:
                self._stamp_round(timeout, "", [])
                return
            except NoAnswer:
                if attempt == attempts:
                    raise
                self.send("")

    def _stamp_round(self, timeout: float, key: str, found: list[str]) -> None:
        self._stamp = (self._stamp + 1) % STAMP_RANGE
        self.send(encode("STAMP", self._stamp))
        deadline = self.deadline(timeout)
        while True:
            reply = self.receive(deadline)
            match reply:
                case Answer("STAMP", text) if text == str(self._stamp):
                    return
                case Answer(other, text) if other == key:
                    found.append(text)
                case None if self.clock.now() >= deadline:
                    raise NoAnswer(
                        f"{self.url}: no answer to STAMP within {timeout:g} s",
                        url=self.url,
                        key="STAMP",
                        reason="silent",
                    )

    def _arrived(self, data: bytes) -> None:
        """What the port delivers: bytes to lines. Raises OSError when flooded, which ends the link."""
        if self.log is not None:
            self.log.received(data)
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > LONGEST_LINE:
            self._rest = b""
        for line in lines:
            self._hand_over(line)
        if self._inbox.qsize() > UNREAD_ANSWERS:
            raise OSError(f"more than {UNREAD_ANSWERS} lines that nobody asked for")

    def _gone(self, error: OSError) -> None:
        self._inbox.put(LinkLost(f"{self.url}: the link is lost: {error}", url=self.url, reason="link"))

    def _hand_over(self, line: bytes) -> None:
        reply = parse_reply(line.rstrip(b"\r").decode("latin-1"))
        if not isinstance(reply, Other) or self._inbox.qsize() < UNREAD_LINES:
            self._inbox.put(reply)

    def close(self) -> None:
        """Close the port. Whatever is still unsent is dropped."""
        self._port.close()
