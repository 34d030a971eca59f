"""A line-by-line link to a controller: questions and answers, a deadline on every wait."""

from __future__ import annotations

from collections.abc import Sequence

from driver.line.clock import Clock
from driver.line.echo import Kind, Mismatch, kind_of
from driver.line.port import Port
from driver.line.protocol import STAMP_RANGE, Answer, encode, encode_query
from driver.line.transport import ANSWER_S as ANSWER_S
from driver.line.transport import Aborted as Aborted
from driver.line.transport import LineDamaged as LineDamaged
from driver.line.transport import LinkLost as LinkLost
from driver.line.transport import NoAnswer as NoAnswer
from driver.line.transport import PortLink
from driver.line.wire_log import WireLog

TELLS = 3  # attempts
ASKS = 2
ASKED_AT_ONCE = 12  # queries before a stamp


class Link(PortLink):
    """An open port to a controller, and what can be asked of it. See `PortLink`."""

    def __init__(self, port: str | Port, clock: Clock, log: WireLog | None = None) -> None:
        super().__init__(port, clock, log)
        self._stamp = clock.unique_ms() % STAMP_RANGE  # a stale answer of an earlier user differs
        self._told: dict[str, str] = {}  # by name: the newest line of each register

    def tell(self, *lines: str) -> None:
        """Send lines that may be sent twice, registers above all, and see that the unit has them.

        Raises:
            NoAnswer, LinkLost: as `synchronise`.
            LineDamaged: one did not come back `TELLS` times.
        """
        self._told.update((line.partition(":")[0], line) for line in lines)
        left = list(lines)
        for _ in range(TELLS):
            self.echo.lost.clear()
            for line in left:
                self.send(line)
            self.synchronise(attempts=2)
            lost = list(self.echo.lost)
            if not lost:
                return
            # what came in a line's place may be another register, which the unit has now: that is told again too
            left = [
                *(line for found in lost for line in self._overwritten(found)),
                *(found.sent for found in lost),
            ]
        raise LineDamaged(
            f"sent {TELLS} times, never came back right: {lost[0].sent!r}", sent=lost[0].sent, reason="line"
        )

    def _overwritten(self, found: Mismatch) -> list[str]:
        """What to tell again of a register that a damaged line has set in place of its own.

        Raises:
            LineDamaged: nobody knows what it held.
        """
        name, mark, _ = found.received.partition(":")
        if not mark or name == found.sent.partition(":")[0] or kind_of(found.received) is not Kind.REGISTER:
            return []
        if name in self._told:
            return [self._told[name]]
        raise LineDamaged(
            f"{found.describe()}: register {name} was overwritten, and what it held is not known; switch the unit off "
            "and on",
            sent=found.sent,
            received=found.received,
            column=found.column,
            reason="line",
        )

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
        return self.ask_all([name + axis])[name + axis]

    def ask_all(self, keys: Sequence[str]) -> dict[str, str | None]:
        """The answers to queries that the unit may not know, by their names with axis; None where it is silent.

        Raises:
            NoAnswer, LinkLost: as `synchronise`.
        """
        found: dict[str, str | None] = dict.fromkeys(keys)
        for begin in range(0, len(keys), ASKED_AT_ONCE):
            left = list(keys[begin : begin + ASKED_AT_ONCE])
            for attempt in range(1, ASKS + 1):
                for key in left:
                    self.send(f"{key}?")
                try:
                    self._stamp_round(ANSWER_S, found)
                    break
                except NoAnswer:  # the stamp was lost on the line, and answers may be
                    if attempt == ASKS:
                        raise
                left = [key for key in left if found[key] is None]
        return found

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
                self._stamp_round(timeout, {})
                return
            except NoAnswer:
                if attempt == attempts:
                    raise
                self.send("")

    def fresh_stamp(self) -> str:
        """The line of a stamp that was not sent before."""
        self._stamp = (self._stamp + 1) % STAMP_RANGE
        return self.stamped

    def stamp(self) -> str:
        """Send a fresh stamp; its line."""
        self.send(self.fresh_stamp())
        return self.stamped

    @property
    def stamped(self) -> str:
        """The line of the newest stamp."""
        return encode("STAMP", self._stamp)

    def _stamp_round(self, timeout: float, found: dict[str, str | None]) -> None:
        self.stamp()
        deadline = self.deadline(timeout)
        while True:
            reply = self.receive(deadline)
            match reply:
                case Answer("STAMP", text) if text == str(self._stamp):
                    if self.echoes and not self.echo.strict:
                        self.echo.resume()
                    return
                case Answer(key, text) if key in found:
                    found[key] = text
                case None if self.clock.now() >= deadline:
                    raise NoAnswer(
                        f"{self.url}: no answer to STAMP within {timeout:g} s",
                        url=self.url,
                        key="STAMP",
                        reason="silent",
                    )
