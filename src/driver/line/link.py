"""A line-based link to a controller: queries and answers, with a deadline on every wait."""

from __future__ import annotations

from collections.abc import Sequence

from arm.errors import Aborted, LinkLost, NoAnswer
from driver.line.clock import Clock
from driver.line.echo import Kind, Mismatch, kind_of
from driver.line.port import Port
from driver.line.protocol import STAMP_RANGE, Answer, encode, encode_query
from driver.line.transport import ANSWER_S, LineDamaged, PortLink, line_damaged
from driver.line.wire_log import WireLog

__all__ = ["ANSWER_S", "Aborted", "LineDamaged", "Link", "LinkLost", "NoAnswer", "line_damaged"]

TELLS = 3  # attempts to set a register
ASKS = 2  # attempts at a group of queries
ASKED_AT_ONCE = 12  # queries in a group, which one stamp ends


class Link(PortLink):
    """An open port to a controller, with queries and answers. See `PortLink`."""

    def __init__(self, port: str | Port, clock: Clock, log: WireLog | None = None) -> None:
        super().__init__(port, clock, log)
        self._stamp = clock.unique_ms() % STAMP_RANGE  # differs from stale answers to an earlier program
        self._told: dict[str, str] = {}  # by name: the latest line of each register

    def tell(self, *lines: str) -> None:
        """Send lines that do no harm if sent twice, such as registers. Repeat those without a correct echo.

        Raises:
            NoAnswer, LinkLost: as `synchronise`.
            LineDamaged: a line has no correct echo after `TELLS` attempts.
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
            # a damaged line may have set another register, which is set again too
            left = [line for found in lost for line in self._overwritten(found)]
            left += [found.sent for found in lost]
        why = f"transmission error: sent {lost[0].sent!r} {TELLS} times, no correct echo"
        raise LineDamaged(why, sent=lost[0].sent, reason="line")

    def _overwritten(self, found: Mismatch) -> list[str]:
        """Lines that restore a register which a damaged line has overwritten.

        Raises:
            LineDamaged: the previous value of the register is not known.
        """
        name, mark, _ = found.received.partition(":")
        if not mark or name == found.sent.partition(":")[0] or kind_of(found.received) is not Kind.REGISTER:
            return []
        if name in self._told:
            return [self._told[name]]
        raise line_damaged(
            f"{found.describe()}: register {name} was overwritten and its old value is not known; switch the unit "
            "off and on",
            found,
        )

    def wait(self, seconds: float) -> None:
        """Wait for that many controller seconds. Lines received meanwhile are dropped, except for `events`.

        Raises:
            Aborted, LinkLost: at once, as `receive`.
        """
        until = self.clock.now() + seconds
        while self.clock.now() < until:
            self.receive(until)

    def await_answer(
        self,
        key: str,
        timeout: float = ANSWER_S,
        text: str | None = None,
        found: dict[str, str | None] | None = None,
    ) -> str:
        """Return the text of the next answer with that key. Other lines are dropped, except for `events`.

        Args:
            timeout: controller seconds.
            text: wait for an answer with this text.
            found: answers to its keys that come meanwhile are put here.

        Raises:
            NoAnswer: none came in time.
            LinkLost: the port is gone.
        """
        deadline = self.deadline(timeout)
        while True:
            reply = self.receive(deadline)
            if isinstance(reply, Answer):
                if reply.key == key and text in (None, reply.text):
                    return reply.text
                if found is not None and reply.key in found:
                    found[reply.key] = reply.text
            elif reply is None and self.clock.now() >= deadline:
                why = f"{self.url}: no answer to {key} within {timeout:g} s"
                raise NoAnswer(why, url=self.url, key=key, reason="silent")

    def ask(self, name: str, axis: str = "", timeout: float = ANSWER_S) -> str:
        """Ask ``NAMEaxis?`` and return the answer.

        Raises:
            NoAnswer: none came in time.
            LinkLost: the port is gone.
        """
        self.send(encode_query(name, axis))
        return self.await_answer(name + axis, timeout)

    def ask_optional(self, name: str, axis: str = "") -> str | None:
        """Send a query that the unit may not know. Return None if only the stamp after it is answered.

        Raises:
            NoAnswer, LinkLost: as `synchronise`.
        """
        return self.ask_all([name + axis])[name + axis]

    def ask_all(self, keys: Sequence[str]) -> dict[str, str | None]:
        """Send queries that the unit may not know. Return each key (name with axis) with its answer, or with None.

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
                    self._stamp_round(found)
                    break
                except NoAnswer:  # the stamp was lost on the line, perhaps with some answers
                    if attempt == ASKS:
                        raise
                left = [key for key in left if found[key] is None]
        return found

    def synchronise(self, attempts: int = 1) -> None:
        """Wait for the answer to a new stamp. The unit has then parsed every line sent before it.

        No answer to an earlier line can come afterwards.

        Args:
            attempts: how many stamps to try. More than one only where noise is expected (power-up, after a stop).

        Raises:
            NoAnswer: no stamp was answered.
            LinkLost: the port is gone.
        """
        for attempt in range(1, attempts + 1):
            try:
                self._stamp_round({})
                return
            except NoAnswer:
                if attempt == attempts:
                    raise
                self.send("")

    def fresh_stamp(self) -> str:
        """Return the line of a new stamp."""
        self._stamp = (self._stamp + 1) % STAMP_RANGE
        return self.stamped

    def stamp(self) -> str:
        """Send a new stamp. Return its line."""
        self.send(self.fresh_stamp())
        return self.stamped

    @property
    def stamped(self) -> str:
        """Line of the latest stamp."""
        return encode("STAMP", self._stamp)

    def _stamp_round(self, found: dict[str, str | None]) -> None:
        self.stamp()
        self.await_answer("STAMP", ANSWER_S, str(self._stamp), found)
        if self.echoes and not self.echo.strict:
            self.echo.resume()
