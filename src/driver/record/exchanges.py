"""Read a recording: what came back for each line sent, and how echo and answer of a stamp lie in each other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from driver.line.protocol import Answer, parse_reply
from driver.line.splitter import LineSplitter
from driver.line.transport import LONGEST_LINE
from driver.record.tape import RECEIVED, SENT, STEP, Event

ENDS = {"\r\n": "CR LF", "\n": "LF", "\r": "CR", "": "none"}
_END = r"(\r\n|\n|\r)"


@dataclass(frozen=True)
class Exchange:
    """A line sent, and what came before the next one was.

    Attributes:
        step: of the recording.
        line: without its end.
        time_s: when it was sent.
        received: times and texts, as they came.
    """

    step: str
    line: str
    time_s: float
    received: tuple[tuple[float, str], ...]

    @property
    def text(self) -> str:
        return "".join(text for _, text in self.received)

    @property
    def answer(self) -> str | None:
        """Text of the answer to a query or stamp, if one came as a line of its own."""
        key = self.line.partition(":")[0].removesuffix("?")
        replies = (
            parse_reply(line.text) for line in LineSplitter(LONGEST_LINE).take(self.text.encode("latin-1"))
        )
        return next((r.text for r in replies if isinstance(r, Answer) and r.key == key), None)

    def answered_s(self) -> float | None:
        """Time from sending a stamp to the end of its answer."""
        so_far = ""
        for time_s, text in self.received:
            so_far += text
            if re.search(re.escape(self.line.replace(":", "=")) + _END, so_far):
                return time_s - self.time_s
        return None


def exchanges(events: Sequence[Event]) -> list[Exchange]:
    """Return the exchanges of all steps, in order. What came before the first line of a step is none of them."""
    found: list[Exchange] = []
    step, line, time_s = "", None, 0.0
    received: list[tuple[float, str]] = []
    for event in (*events, Event(0.0, STEP, "")):
        if event.kind == RECEIVED:
            received.append((event.time_s, event.data))
            continue
        if line is not None:
            found.append(Exchange(step, line, time_s, tuple(received)))
        line, received, time_s = None, [], event.time_s
        if event.kind == STEP:
            step = event.data
        elif event.kind == SENT:
            line = event.data.removesuffix("\n")
    return found


def heard_in(events: Sequence[Event], step: str) -> list[tuple[float, str]]:
    """Return times and texts of what came in a step, as they came."""
    found, inside = [], False
    for event in events:
        if event.kind == STEP:
            inside = event.data == step
        elif inside and event.kind == RECEIVED:
            found.append((event.time_s, event.data))
    return found


def lines_in(events: Sequence[Event], step: str) -> list[tuple[float, str]]:
    """Return the lines that came in a step, each with the time of its end; empty ones are left out."""
    splitter = LineSplitter(LONGEST_LINE)
    return [
        (time_s, line.text)
        for time_s, text in heard_in(events, step)
        for line in splitter.take(text.encode("latin-1"))
        if line.text
    ]


@dataclass(frozen=True)
class StampForm:
    """How a unit answers a stamp.

    Attributes:
        echo: ``none``, ``before`` the answer, ``after`` it, ``interleaved`` byte by byte, or ``odd``: part of it,
            or other bytes than those sent.
        answered: the answer is a line of its own, or interleaved with the echo.
        echo_end, answer_end: line ends, of `ENDS`.
        prompt: other text in the same line as the answer, or behind it.
        text: all that came.
    """

    echo: str
    answered: bool
    echo_end: str
    answer_end: str
    prompt: str
    text: str


def form_of(exchange: Exchange) -> StampForm:
    """Return how a stamp was echoed and answered."""
    line, text = exchange.line, exchange.text
    answer = line.replace(":", "=")
    sent, said = re.escape(line), re.escape(answer)
    if found := re.fullmatch(sent + _END + said + _END, text):
        return StampForm("before", True, ENDS[found[1]], ENDS[found[2]], "", text)
    if found := re.fullmatch(said + _END + sent + _END, text):
        return StampForm("after", True, ENDS[found[2]], ENDS[found[1]], "", text)
    if _interleaved(line, answer, re.sub(r"[\r\n]", "", text)):
        return StampForm("interleaved", True, "", "", "", text)
    if found := re.fullmatch(rf"([^\r\n]*){said}{_END}(.*)", text, re.DOTALL):
        before, after = found[1].strip(), found[3].strip()
        if not _resembles(before + after, line):
            return StampForm("none", True, "", ENDS[found[2]], before or after, text)
    return StampForm("odd" if text else "none", bool(re.search(said + _END, text)), "", "", "", text)


def _interleaved(line: str, answer: str, text: str) -> bool:
    """Whether a text is made of two others, byte by byte, each in its order."""
    if len(text) != len(line) + len(answer):
        return False
    reached = {0}  # so many of the first one's bytes are used
    for place, byte in enumerate(text):
        reached = {
            used + first
            for used in reached
            for first in (0, 1)
            if (first and used < len(line) and line[used] == byte)
            or (not first and place - used < len(answer) and answer[place - used] == byte)
        }
    return bool(reached)  # all of both are used then


def _resembles(text: str, line: str) -> bool:
    """Whether a text has at least three bytes in a row of a line sent."""
    return any(line[at : at + 3] in text for at in range(len(line) - 2))
