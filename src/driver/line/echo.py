"""Use the unit's echo as a checksum: determine which lines sent were echoed exactly, and which were not.

With ``ECHO:1`` the unit sends back what it receives. The protocol has no checksum and segments are relative, so only
the echo shows that a line arrived as sent. `EchoWatch` compares the lines received with the lines sent. It has no clock
and no port of its own.

Lines sent contain neither ``=`` nor ``!``; undamaged answers contain one of them. So each received line is either an
echo or an answer, unless the unit interleaves the two. A line that is neither is damaged; the next line tells which
kind it was. If that is the awaited echo, an answer was damaged. If it is a later echo, the awaited one was damaged.
The echo of a command that was never sent means that the unit has received such a command, so the arm is stopped at
once.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from enum import Enum

from driver.line.protocol import Answer, Failed, Ready, parse_reply

_RECENT = 32  # latest lines, whose echo is recognised if it comes late or twice
_LATEST_TRIPS = 24  # latest echoes, from which the round trip is computed
_SHORT = 20  # characters; the transmission time of a shorter echo is negligible
_RESEMBLANCE = 0.6  # fraction of a line that must agree at its two ends if the rest was damaged
_FEWEST = 6  # characters needed to recognise a line that was cut; many lines share the first five, COORD
_REGISTERS = re.compile(r"REG[A-Z0-9]*|ANAXSETUP[A-H]|IDLEREL|COORDGRP|COORDDISCONT")
_QUERIES = re.compile(r"STAMP|ECHO|R[A-H]?|STOP|PURGE")
_WAIT = re.compile(r"R[A-H]?:")
_COMMAND = re.compile(r"[A-Z][A-Z0-9]*:|.*COORD[A-Z0-9]+:", re.DOTALL)  # begins as a command or contains one
_ANSWER_HEAD = re.compile(r"(?:[A-Z][A-Z0-9]*=|R[A-H]?!|FAIL!)[^:?]*")


class Kind(Enum):
    """Kind of a line, which determines the reaction if it is damaged.

    Attributes:
        MOTION: the arm may move differently than commanded: stop.
        REGISTER: send it again.
        QUERY: ask again, or repeat it until it has effect (STOP).
    """

    MOTION = "motion"
    REGISTER = "register"
    QUERY = "query"


def kind_of(line: str) -> Kind:
    """Classify a line (without its end). An unknown line counts as motion."""
    name, mark, _ = line.partition(":")
    if not mark and line.endswith("?"):
        return Kind.QUERY
    if _QUERIES.fullmatch(name):
        return Kind.QUERY
    return Kind.REGISTER if _REGISTERS.fullmatch(name) else Kind.MOTION


@dataclass(frozen=True)
class Mismatch:
    """A line whose echo differs.

    Attributes:
        sent: the line; "" if none was sent.
        received: the echo; "" if there was none.
        twice: the echo came twice although the line was sent once.
        column: of the first character that differs, from 1.
    """

    sent: str
    received: str
    twice: bool = False

    @property
    def column(self) -> int:
        return _common(self.sent, self.received) + 1

    def describe(self) -> str:
        """Describe the mismatch in one phrase for the operator."""
        if self.twice:
            return f"transmission error: echo {self.received[:200]!r} came twice, but the line was sent once"
        if not self.sent:
            return f"transmission error: echo {self.received[:200]!r} of a line that was never sent"
        if not self.received:
            return f"transmission error: sent {self.sent!r}, no echo"
        return f"transmission error: sent {self.sent!r}, echo {self.received[:200]!r} differs at column {self.column}"


@dataclass(frozen=True)
class _Awaited:
    number: int
    text: str
    kind: Kind
    left_s: float


class EchoWatch:
    """Matches received lines with the lines sent. Not thread-safe.

    While `strict` is False, echoes are skipped in any order and not checked. This is so before the unit's way of
    echoing is known, after a stop, and with a unit that does not echo.

    Attributes:
        strict: the echo of every line is checked.
        verified: this line and all before it have been echoed or need no echo; a mismatch holds the number back.
        mismatch: the first motion line whose echo differs.
        lost: register lines whose echo differs; the sender sends them again.
        round_trip_s: time from the last byte of a short line to its echo. The lower quartile of recent lines, because
            slower echoes have waited behind answers and longer echoes.
        mixed: an answer has interrupted an echo.
        stops: number of STOP echoes since `forget`.
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
        self._odd = ""  # an unjudged line that is neither an answer nor an echo
        self._head = ""  # beginning of an echo that an answer has interrupted
        self._begun = ""  # beginning of an answer that the end of an echo has interrupted
        self._asked: deque[str] = deque(maxlen=_RECENT)  # keys of pending answers
        self._ready = ""  # answer that ends the latest wait
        self._answered = False  # the previous line was an answer
        self._passed: deque[str] = deque(maxlen=_RECENT)  # echoes that came while nothing was checked

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
        """Whether an answer is pending."""
        return bool(self._asked)

    def forget(self) -> None:
        """Stop checking: after a STOP or a broken line, pending echoes may never come."""
        self.strict = False
        self.verified = self.sent_lines
        self.mismatch, self.stops = None, 0
        self._awaited.clear()
        self._asked.clear()
        self.lost.clear()
        self._odd = self._head = self._begun = ""

    def resume(self) -> None:
        """Check every echo from now on: everything sent before has been executed."""
        self.forget()
        self.strict = True

    def sent(self, line: str, left_s: float) -> int:
        """Record a sent line (without its end) whose last byte leaves at `left_s`. Return its number."""
        if not line:
            return self.sent_lines  # the echo of an empty line is a line end alone
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
        """Give up all pending answers."""
        self._asked.clear()

    def take(self, line: str, now_s: float, torn: bool = False) -> str | None:
        """Take a received line and return the part of it that is an answer, or None if it is an echo or damaged.

        Args:
            line: without its end; may be empty.
            now_s: when it came.
            torn: see `driver.line.splitter.Received`.
        """
        begun, self._begun = self._begun, ""
        if begun and self._begins_answer(begun + line):
            self._begun = begun + line
            return None
        line = begun + line if begun and self._is_asked(begun + line) else line
        if not self.strict:
            return self._loose(line, torn)
        if not line and self._head != (self._awaited[0].text if self._awaited else None):
            return None
        head, self._head = self._head, ""
        line = head + line
        awaited = self._awaited[0] if self._awaited else None
        if awaited is not None:
            before = line.removesuffix(awaited.text)
            behind_answer = line.endswith(awaited.text) and self._ends_an_answer(before, torn)
            if line == awaited.text or behind_answer:
                self._came(now_s)
                return None
            if self._woven(line, awaited.text):
                self._came(now_s)
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
                self._came(now_s)
                return None
        if awaited is not None and self._interrupts(line, awaited.text):
            return line[len(self._head) :]
        if isinstance(parse_reply(line), Answer):
            return line  # to a query that was given up
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
        """Whether a line is the echo of a query and then the beginning of its answer, cut off by the echo's line end.

        A unit that interleaves bytes and ends lines in CR LF sends ``STAMP:5 S CR T LF AMP=5``. The beginning is kept
        and joined with the next line.
        """
        if line.startswith(sent) and kind_of(sent) is Kind.QUERY and self._begins_answer(line[len(sent) :]):
            self._begun = line[len(sent) :]
            return True
        return False

    def _begins_answer(self, text: str) -> bool:
        """Whether `text` is the beginning of a pending answer, before its value."""
        heads = [f"{key}=" for key in self._asked] + ([self._ready[:-1]] if self._ready else [])
        return bool(text) and any(head.startswith(text) for head in heads)

    def _is_asked(self, line: str) -> bool:
        reply = parse_reply(line)
        asked = isinstance(reply, Answer) and reply.key in self._asked
        return asked or (line != "" and line == self._ready)

    def came(self, line: str) -> bool:
        """Whether a line was echoed while nothing was checked."""
        return line in self._passed

    def _answers(self, line: str) -> bool:
        """Whether a line is a pending answer, or one that may come at any time."""
        reply = parse_reply(line)
        self._answered = isinstance(reply, Answer | Ready | Failed)
        if isinstance(reply, Answer) and reply.key in self._asked:
            while reply.key == "STAMP" and self._asked[0] != "STAMP":
                self._asked.popleft()  # answers come in order, so these have none
            self._asked.remove(reply.key)
            return True
        return isinstance(reply, Ready | Failed)

    def _ends_an_answer(self, before: str, torn: bool) -> bool:
        """Whether the text before an echo, in the same line, is an answer whose line end was damaged.

        A single byte counts only if it differs from LF in one bit and the answer's end lacks its LF. Otherwise it was
        added on the way to the unit, which has ignored it.
        """
        if _ANSWER_HEAD.fullmatch(before):
            return True
        return torn and self._answered and len(before) == 1 and (ord(before) ^ ord("\n")).bit_count() == 1

    def _came(self, now_s: float) -> None:
        """Record the echo of the oldest awaited line."""
        line = self._awaited.popleft()
        if self.mismatch is None:
            self.verified = line.number
        if len(line.text) < _SHORT:
            self._trips.append(max(now_s - line.left_s, 0.0))
        self._odd = ""

    def _skip(self, lines: int) -> None:
        """Record that the oldest awaited lines have no echo, as that of a later line has come."""
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
        """Whether the line is the beginning of the awaited one (up to all but its end) and then a pending answer."""
        for size in range(_common(line, awaited), 0, -1):
            reply = parse_reply(line[size:])
            if isinstance(reply, Answer) and reply.key in self._asked:
                self._asked.remove(reply.key)
                self._head, self.mixed = line[:size], True
                return True
        return False

    def _judge(self, line: str, awaited: _Awaited | None) -> None:
        """Judge a line that is neither an echo nor an answer."""
        if line in self._recent:
            if kind_of(line) is Kind.MOTION and self.mismatch is None:
                self.mismatch = Mismatch("", line, twice=True)  # a query or a register twice does no harm
            return
        if awaited is not None and _resembles(line, awaited.text):
            self._failed(self._awaited.popleft(), line)
            rest = line[len(awaited.text) :] if line.startswith(awaited.text) else ""
            if rest and self._awaited and _resembles(rest, self._awaited[0].text):
                # its end was lost: the unit took both for one line
                self._failed(self._awaited.popleft(), rest)
            return
        if "=" not in line and _COMMAND.match(line) and self.mismatch is None:
            self.mismatch = Mismatch("", line)
        elif awaited is not None:
            self._odd = line  # noise, or a damaged answer


def _common(a: str, b: str) -> int:
    """Length of the common prefix."""
    return next((k for k, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))


def _resembles(line: str, awaited: str) -> bool:
    """Whether a line is the awaited one with a part damaged, lost or added."""
    begins = _common(line, awaited)
    if begins == len(awaited) or (begins == len(line) and begins >= _FEWEST):
        return True  # joined with another line, or cut
    ends = _common(line[begins:][::-1], awaited[begins:][::-1])
    return begins + ends >= _RESEMBLANCE * len(awaited)
