"""Ask a unit of which nothing is known what it is and how it answers; every byte is kept.

Only questions are sent (`driver.record.questions`). Until the unit has identified itself as `driver.mars.identity`
requires, these are ECHO, STAMP and VER. A question waits until the one before is answered, or has had its time: bytes
lost on the line can then never join two of them to a command. The exceptions are bursts of stamps, and queries at rest,
none of which has a colon.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from arm.errors import InputError
from driver.line.clock import Clock
from driver.line.link import ANSWER_S, Link, LinkLost, NoAnswer
from driver.line.port import Port, SerialPort
from driver.line.protocol import Answer, encode, encode_query
from driver.mars.identity import identify
from driver.record.questions import AXES, HELP, UNKNOWN, register_kinds
from driver.record.tape import QuestionPort, Tape
from driver.record.unit_record import Ended, UnitRecord

LISTEN_S = 1.0  # before the first byte is sent
QUIET_S = 0.06  # silence after an answer that is there, for an echo behind it
ODD_QUIET_S = 1.0  # silence after bytes in which the answer is not found
QUERY_S = 0.5  # time for a query that the unit may not know
STAMPS = 3  # with the echo on, and off
HELP_S = 60.0  # most time for the list of commands; at 19200 baud 115 kB
TRIES = 3  # stamps to a unit that has not answered yet
BURST = 4  # stamps sent together
TRIPS = 20  # stamps one by one, for the time of an answer
PERIOD_S = 0.25  # from one reading at rest to the next
SILENT_ROUNDS = 3  # readings without any answer, after which the unit is given up
_POLL_S = 0.01

Progress = Callable[[str, UnitRecord], None]


class Recorder:
    """Records one unit.

    Args:
        port: see `driver.line.port.open_port`; or an open port.
        firmware: name that VER must begin with; see `driver.mars.identity.identify`.
        seconds: how long the counts are read at rest.
        clock: of all times and deadlines.
        progress: called at the beginning of each step and at each reading, with the record so far.

    Raises:
        InputError: the port cannot be opened.
    """

    def __init__(
        self,
        port: str | Port,
        firmware: str,
        seconds: float,
        clock: Clock | None = None,
        progress: Progress = lambda step, record: None,
    ) -> None:
        self.clock = clock or Clock()
        self.tape = Tape(self.clock)
        self._firmware, self._seconds, self._progress = firmware, seconds, progress
        self._ended, self._step_name = Ended.INTERRUPTED, ""
        self._manners: dict[str, bool] | None = None
        opened = SerialPort(port, ANSWER_S) if isinstance(port, str) else port
        self.link = Link(QuestionPort(opened, self.tape), self.clock)

    def record(self) -> UnitRecord:
        """What was recorded so far."""
        return UnitRecord(self._seconds, self._ended, self._manners, tuple(self.tape.events))

    def run(self) -> UnitRecord:
        """Ask everything, and close the port. However it ends, `record` has all that came until then.

        Raises:
            InputError: nothing answers, or nothing that is the firmware.
            NoAnswer: the unit stopped answering.
            LinkLost: the port is gone.
        """
        try:
            self._ask_all()
            self._ended = Ended.COMPLETE
        except LinkLost:
            self._ended = Ended.LOST
            raise
        except NoAnswer:
            self._ended = Ended.STOPPED
            raise
        finally:
            self.link.close()
        return self.record()

    def _ask_all(self) -> None:
        self._step("before")
        self.link.wait(LISTEN_S)
        self._step("as found")
        echoes = self._first_words()
        for on in (1, 0):
            self._step(f"echo {'on' if on else 'off'}")
            self._send(encode("ECHO", on), None, QUERY_S)
            answered = self._stamps(STAMPS)
            self._send("VER?", "VER=", ANSWER_S)
            self._step(f"burst, echo {'on' if on else 'off'}")
            self._burst()
        if answered:
            self._step("answer times")
            self._stamps(TRIPS)
        self._step("identification")
        self._identify()
        self._step("questions")
        keys = self._questions()
        self._step("rest")
        self._rest(keys)
        self._step("help")
        self._optional(HELP, None, HELP_S)
        self._step("end")
        self._send(encode("ECHO", int(echoes)), None, QUERY_S)

    # -- the steps

    def _first_words(self) -> bool:
        """Send the first bytes to a unit that may have been switched on just now. Return whether it echoes.

        Raises:
            InputError: nothing at all came back.
        """
        self._send("", None, QUERY_S)  # ends a partial line of an earlier program
        for _ in range(TRIES):
            if self._stamps(1):
                break
        if not self.tape.heard:
            self._ended = Ended.SILENT
            why = f"port {self.link.url}: nothing comes back; is the controller connected and switched on?"
            raise InputError(why, port=self.link.url, reason="silent")
        return self.link.stamped in self.tape.heard

    def _identify(self) -> None:
        """Let the driver identify the unit, as it does at every opening.

        Raises:
            InputError: it is not identified.
        """
        try:
            _, manners = identify(self.link, self._firmware)
        except InputError as error:
            if isinstance(error.__cause__, LinkLost):
                raise error.__cause__ from error
            self._ended = Ended.UNIDENTIFIED
            raise
        self._manners = {
            "echoes": manners.echoes,
            "adapter": manners.adapter,
            "takes_turns": manners.takes_turns,
        }
        # from here on the bytes are kept, not judged: an echo that differs must not end the recording
        self.link.echoes = self.link.takes_turns = False
        self.link.echo.forget()
        self._send(encode("ECHO", 0), None, QUERY_S)
        self._sure()

    def _questions(self) -> list[str]:
        """Ask for each thing once. Return the keys that are answered and may change."""
        self._optional("ST?", "ST=")
        self._optional(UNKNOWN, None)
        keys = ["ST", *(f"AP{axis}" for axis in AXES if self._optional(f"AP{axis}?", f"AP{axis}="))]
        if self._optional("COORDAP?", "COORDAP="):
            keys.append("COORDAP")
        for name, axes in register_kinds():
            for axis in axes:
                if not self._optional(encode_query(name, axis), f"{name}{axis}="):
                    break  # the others of its kind are not asked either
        return keys

    def _rest(self, keys: list[str]) -> None:
        end, silent = self.clock.now() + self._seconds, 0
        while (begin := self.clock.now()) < end:
            silent = 0 if self._round(keys) else silent + 1
            if silent == SILENT_ROUNDS:
                raise self._silence()
            self._progress(self._step_name, self.record())
            self.link.wait(max(begin + PERIOD_S - self.clock.now(), QUIET_S))

    def _round(self, keys: list[str]) -> bool:
        """Read everything once. Return whether anything was answered."""
        for key in keys:
            self.link.send(f"{key}?")
        missing, deadline = set(keys), self.link.deadline(ANSWER_S)
        while missing and self.clock.now() < deadline:
            reply = self.link.receive(deadline)
            if isinstance(reply, Answer):
                missing.discard(reply.key)
        return len(missing) < len(keys)

    # -- one question

    def _step(self, name: str) -> None:
        self._step_name = name
        self.tape.step(name)
        self._progress(name, self.record())

    def _stamps(self, count: int) -> int:
        """Send stamps one by one. Return how many were answered."""
        answered = 0
        for _ in range(count):
            line = self.link.fresh_stamp()
            answered += self._send(line, line.replace(":", "="), ANSWER_S)
        return answered

    def _burst(self) -> None:
        """Send stamps together, so that answers come while lines are echoed."""
        lines = [self.link.stamp() for _ in range(BURST)]
        self._listen(lines[-1].replace(":", "="), len(self.tape.heard), self.link.deadline(ANSWER_S))

    def _optional(self, line: str, answer: str | None, within_s: float = QUERY_S) -> bool:
        """Send a query that the unit may not know. Return whether it was answered, also behind the stamp that follows.

        Raises:
            NoAnswer: the stamp was not answered.
        """
        mark = len(self.tape.heard)
        self.link.send(line)
        if not self._listen(answer, mark, self.clock.now() + within_s):
            self._sure()
        return answer is not None and _is_in(self.tape.heard, answer, mark)

    def _sure(self) -> None:
        """Make sure that the unit still answers.

        Raises:
            NoAnswer: it does not.
        """
        for _ in range(TRIES):
            if self._stamps(1):
                return
            self._send("", None, QUERY_S)
        raise self._silence()

    def _silence(self) -> NoAnswer:
        why = f"{self.link.url}: the unit stopped answering, in the step {self._step_name!r}"
        return NoAnswer(why, url=self.link.url, step=self._step_name, reason="silent")

    def _send(self, line: str, answer: str | None, within_s: float) -> bool:
        """Send a line and listen. Return whether its answer came; None: there may be none."""
        mark = len(self.tape.heard)
        self.link.send(line)
        limit = self.clock.now() + within_s if answer is None else self.link.deadline(within_s)
        return self._listen(answer, mark, limit)

    def _listen(self, answer: str | None, mark: int, deadline: float) -> bool:
        """Keep what comes until the answer is complete and nothing follows, or until the deadline."""
        complete = False
        begins_by = self.link.deadline(ANSWER_S)  # what has not begun by then does not come
        while (now := self.clock.now()) < deadline:
            came = len(self.tape.heard) > mark
            complete = complete or (came and answer is not None and _is_in(self.tape.heard, answer, mark))
            quiet_s = QUIET_S if complete else ODD_QUIET_S
            if now - self.tape.heard_at >= quiet_s if came else now >= begins_by:
                break
            self.link.receive(min(deadline, now + _POLL_S))
        return complete


def _is_in(text: str, answer: str, mark: int) -> bool:
    """Whether a line that begins so, or ends in one, is complete behind a mark."""
    return re.compile(rf"{re.escape(answer)}[^\r\n]*[\r\n]").search(text, mark) is not None
