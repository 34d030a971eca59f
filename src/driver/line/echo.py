"""A unit's echo as the checksum of the line: what of the lines sent has come back exactly, and what has not.

With ``ECHO:1`` the unit sends back what it has received. The protocol has no checksum and segments are relative, so
this is the only thing that tells that a line arrived as it was sent. `EchoWatch` takes lines as they are sent and
lines as they are received; it has no clock and no port of its own.

Lines that are sent have no ``=`` and no ``!``; sound answers have one. So where the unit mixes nothing, each received
line is one or the other. What is neither is judged by what comes next: the echo that was awaited (then an answer was
damaged), or a later one (then the awaited one was). But a command that was never sent means that the unit has received
one: that stops at once, whatever comes next.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from enum import Enum

from driver.line.protocol import Answer, Failed, Ready, parse_reply

_RECENT = 32  # lines whose echo is known when it comes late or twice
_LATEST_TRIPS = 24  # echoes that the round trip is of
_SHORT = 20  # characters of a line whose echo takes next to no time
_RESEMBLANCE = 0.6  # of a line, at its two ends: the rest was damaged
_FEWEST = 6  # characters that tell that a line was cut; answers share the first five, COORD
_REGISTERS = re.compile(r"REG[A-Z0-9]*|ANAXSETUP[A-H]|IDLEREL|COORDGRP|COORDDISCONT")
_QUERIES = re.compile(r"STAMP|ECHO|R[A-H]?|STOP|PURGE")
_WAIT = re.compile(r"R[A-H]?:")
_COMMAND = re.compile(r"[A-Z][A-Z0-9]*:|.*COORD[A-Z0-9]+:", re.DOTALL)  # begins like one, or ends in one
_ANSWER_HEAD = re.compile(r"(?:[A-Z][A-Z0-9]*=|R[A-H]?!|FAIL!)[^:?]*")


class Kind(Enum):
    """What a damaged line means.

    Attributes:
        MOTION: the arm may do something else than it was told: stop.
        REGISTER: may be sent again.
        QUERY: is asked again, or repeated until its effect is seen (STOP).
    """

    MOTION = "motion"
    REGISTER = "register"
    QUERY = "query"


def kind_of(line: str) -> Kind:
    """What a line (without its end) is; what is not known counts as motion."""
    name, mark, _ = line.partition(":")
    if not mark and line.endswith("?"):
        return Kind.QUERY
    if _QUERIES.fullmatch(name):
        return Kind.QUERY
    return Kind.REGISTER if _REGISTERS.fullmatch(name) else Kind.MOTION


@dataclass(frozen=True)
class Mismatch:
    """A line that did not come back as it was sent.

    Attributes:
        sent: the line; "" if none was.
        received: what came in its place, or "" if nothing did.
        twice: it was sent once.
        column: of the first character that differs, from 1.
    """

    sent: str
    received: str
    twice: bool = False

    @property
    def column(self) -> int:
        return _common(self.sent, self.received) + 1

    def describe(self) -> str:
        """One phrase for a person."""
        if self.twice:
            return f"the line was damaged: {self.received[:200]!r} came back twice, and was sent once"
        if not self.sent:
            return f"the line was damaged: {self.received[:200]!r} came back, and was never sent"
        if not self.received:
            return f"the line was damaged: sent {self.sent!r}, nothing came back"
        return (
            f"the line was damaged: sent {self.sent!r}, came back as {self.received[:200]!r}, which differs at "
            f"column {self.column}"
        )


@dataclass(frozen=True)
class _Awaited:
    number: int
    text: str
    kind: Kind
    left_s: float


class EchoWatch:
    """Follows the echo of everything that is sent. Not for two threads.

    While `strict` is False nothing is judged: lines that came back are passed over, whatever their order. So it is
    before the unit's manners are known, after a stop, and with a unit that does not echo.

    Attributes:
        strict: every line is awaited.
        verified: number of the newest line that came back, or that need not come back, with all before it; it stays
            where a mismatch was.
        mismatch: the first motion line that did not come back exactly.
        lost: register lines that did not come back exactly, and as what; whoever sent them sends them again.
        round_trip_s: between the last byte of a short line and its echo; of the latest ones the lower quartile, for the
            others waited behind answers and longer echoes.
        mixed: an answer was seen in the middle of an echo.
        stops: how many echoes of STOP have come since `forget`.
    """

    def __init__(self) -> None:
        self.strict = False
        self.sent_lines = 0
        self.verified = 0
        self.mismatch: Mismatch | None = None
        self.lost: list[Mismatch] = []
        self.mixed = False
        self.stops = 0
        self._awaited: deque[_Awaited] = deque()
        self._recent: deque[str] = deque(maxlen=_RECENT)
        self._trips: deque[float] = deque(maxlen=_LATEST_TRIPS)
        self._odd = ""  # a line that is neither an answer nor an echo, not yet judged
        self._head = ""  # of an echo that an answer has interrupted
        self._begun = ""  # of an answer that the end of an echo has interrupted
        self._asked: deque[str] = deque(maxlen=_RECENT)  # keys of answers to come
        self._ready = ""  # what ends the newest wait
        self._answered = False  # the line before was an answer
        self._passed: deque[str] = deque(maxlen=_RECENT)  # echoes that came while nothing was judged

    @property
    def round_trip_s(self) -> float:
        trips = sorted(self._trips)
        return trips[len(trips) // 4] if trips else 0.0

    @property
    def unechoed_bytes(self) -> int:
        """Bytes sent whose echo has not come."""
        return sum(len(line.text) + 1 for line in self._awaited)

    @property
    def unanswered(self) -> bool:
        """A query's answer is still to come."""
        return bool(self._asked)

    def forget(self) -> None:
        """A stop was sent, or the line was broken: what was awaited may never come, and nothing is judged."""
        self.strict = False
        self.verified = self.sent_lines
        self.mismatch, self.stops = None, 0
        self._awaited.clear()
        self._asked.clear()
        self.lost.clear()
        self._odd = self._head = self._begun = ""

    def resume(self) -> None:
        """Everything that was sent before has been obeyed: from now on every line is awaited."""
        self.forget()
        self.strict = True

    def sent(self, line: str, left_s: float) -> int:
        """A line (without its end) was sent, its last byte leaves at that time; its number."""
        if not line:
            return self.sent_lines  # an empty line comes back as an end of line alone
        self.sent_lines += 1
        self._recent.append(line)
        if line.endswith("?"):
            self._asked.append(line[:-1])
        elif line.startswith("STAMP:"):
            self._asked.append("STAMP")
        elif _WAIT.fullmatch(line):
            self._ready = f"{line[:-1]}!"
        if self.strict:
            self._awaited.append(_Awaited(self.sent_lines, line, kind_of(line), left_s))
        else:
            self.verified = self.sent_lines
        return self.sent_lines

    def forgive_answers(self) -> None:
        """Answers that have not come by now will not come."""
        self._asked.clear()

    def take(self, line: str, now_s: float, torn: bool = False) -> str | None:
        """What of a received line (without its end; also an empty one) is an answer, or None: an echo, or damaged.

        Args:
            line: the line.
            now_s: when it came.
            torn: see `driver.line.splitter.Received`.
        """
        begun, self._begun = self._begun, ""
        if begun and self._begins_answer(begun + line):
            self._begun = begun + line
            return None
        if begun and self._is_asked(begun + line):
            line = begun + line
        if not self.strict:
            return self._loose(line, torn)
        if not line and self._head != (self._awaited[0].text if self._awaited else None):
            return None
        head, self._head = self._head, ""
        line = head + line
        awaited = self._awaited[0] if self._awaited else None
        if awaited is not None and line == awaited.text:
            self._came(1, now_s)
            return None
        if (
            awaited is not None
            and line.endswith(awaited.text)
            and self._ends_an_answer(line[: -len(awaited.text)], torn)
        ):
            self._came(1, now_s)
            return None
        if awaited is not None and self._woven(line, awaited.text):
            self._came(1, now_s)
            self.mixed = True
            return None
        if self._answers(line):
            return line
        if torn and self._begins_answer(line):
            self._begun = line
            return None
        for place, later in enumerate(self._awaited):
            if place and line == later.text:
                self._skip(place)
                self._came(1, now_s)
                return None
        if awaited is not None and self._interrupts(line, awaited.text):
            return line[len(self._head) :]
        if isinstance(parse_reply(line), Answer):
            return line  # to a question that was given up
        self._judge(line, awaited)
        return None

    def _loose(self, line: str, torn: bool) -> str | None:
        self.stops += line == "STOP:"
        if line in self._recent:
            self._passed.append(line)
            return None
        if self._recent and self._woven(line, self._recent[-1]):
            self._passed.append(self._recent[-1])
            return None
        if torn and self._begins_answer(line):
            self._begun = line
            return None
        if not self._answers(line) and any(self._interrupts(line, sent) for sent in self._recent):
            line, self._head = line[len(self._head) :], ""
        return line or None

    def _woven(self, line: str, sent: str) -> bool:
        """Whether a line is the echo of a query and the beginning of its answer, which the echo's end has cut off.

        So it is with a unit that mixes bytes and ends lines in two of them: ``STAMP:5 S CR T LF AMP=5``. The beginning
        is kept, to be joined with what follows.
        """
        if line.startswith(sent) and kind_of(sent) is Kind.QUERY and self._begins_answer(line[len(sent) :]):
            self._begun = line[len(sent) :]
            return True
        return False

    def _begins_answer(self, text: str) -> bool:
        """Whether it is the beginning of an answer that was asked for, before its value."""
        heads = [f"{key}=" for key in self._asked] + ([self._ready[:-1]] if self._ready else [])
        return bool(text) and any(head.startswith(text) for head in heads)

    def _is_asked(self, line: str) -> bool:
        reply = parse_reply(line)
        return (isinstance(reply, Answer) and reply.key in self._asked) or (
            line != "" and line == self._ready
        )

    def came(self, line: str) -> bool:
        """Whether a line came back while nothing was judged."""
        return line in self._passed

    def _answers(self, line: str) -> bool:
        """Whether a line is an answer that was asked for, or one that comes when it likes."""
        reply = parse_reply(line)
        self._answered = isinstance(reply, Answer | Ready | Failed)
        if isinstance(reply, Answer) and reply.key in self._asked:
            while reply.key == "STAMP" and self._asked[0] != "STAMP":
                self._asked.popleft()  # answered in order, so these have no answer
            self._asked.remove(reply.key)
            return True
        return isinstance(reply, Ready | Failed)

    def _ends_an_answer(self, before: str, torn: bool) -> bool:
        """Whether what stands before an echo, in the same line, is an answer whose end was damaged.

        A byte alone is that only where the end of the answer lacks one: else it was put before the line on its way
        there, and the unit has ignored that.
        """
        if _ANSWER_HEAD.fullmatch(before):
            return True
        return torn and self._answered and len(before) == 1 and (ord(before) ^ ord("\n")).bit_count() == 1

    def _came(self, lines: int, now_s: float) -> None:
        """The oldest awaited lines have come back."""
        for _ in range(lines):
            line = self._awaited.popleft()
            if self.mismatch is None:
                self.verified = line.number
            if len(line.text) < _SHORT:
                self._trips.append(max(now_s - line.left_s, 0.0))
        self._odd = ""

    def _skip(self, lines: int) -> None:
        """The oldest awaited lines have not come back, for a later one has."""
        for _ in range(lines):
            self._failed(self._awaited.popleft(), self._odd)
            self._odd = ""

    def _failed(self, line: _Awaited, received: str) -> None:
        if line.kind is Kind.MOTION and self.mismatch is None:
            self.mismatch = Mismatch(line.text, received)
        elif line.kind is Kind.REGISTER:
            self.lost.append(Mismatch(line.text, received))
        if self.mismatch is None:
            self.verified = line.number

    def _interrupts(self, line: str, awaited: str) -> bool:
        """Whether the line is the beginning of the awaited one, or all but its end, and then an answer asked for."""
        for size in range(_common(line, awaited), 0, -1):
            reply = parse_reply(line[size:])
            if isinstance(reply, Answer) and reply.key in self._asked:
                self._asked.remove(reply.key)
                self._head, self.mixed = line[:size], True
                return True
        return False

    def _judge(self, line: str, awaited: _Awaited | None) -> None:
        """A line that is neither."""
        if line in self._recent:
            if kind_of(line) is Kind.MOTION and self.mismatch is None:
                self.mismatch = Mismatch(
                    "", line, twice=True
                )  # obeyed twice; a query or a register does no harm twice
            return
        if awaited is not None and _resembles(line, awaited.text):
            self._failed(self._awaited.popleft(), line)
            self._judge_joined(line[len(awaited.text) :] if line.startswith(awaited.text) else "")
            return
        if "=" not in line and _COMMAND.match(line) and self.mismatch is None:
            self.mismatch = Mismatch("", line)
        elif awaited is not None:
            self._odd = line  # noise, or a damaged answer

    def _judge_joined(self, rest: str) -> None:
        """What followed a line whose end was lost: the unit took both for one."""
        if rest and self._awaited and _resembles(rest, self._awaited[0].text):
            self._failed(self._awaited.popleft(), rest)


def _common(a: str, b: str) -> int:
    """Length of the common beginning."""
    return next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))


def _resembles(line: str, awaited: str) -> bool:
    """Whether a line is the awaited one with some of it damaged, lost or added."""
    begins = _common(line, awaited)
    if begins == len(awaited) or (begins == len(line) and begins >= _FEWEST):
        return True  # joined with another, or cut
    ends = _common(line[begins:][::-1], awaited[begins:][::-1])
    return begins + ends >= _RESEMBLANCE * len(awaited)
