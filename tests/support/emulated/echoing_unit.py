"""A unit that echoes, without a line: what it sends back for what it takes."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

from driver.line.echo import EchoWatch
from driver.line.splitter import LineSplitter

ENDS = {"LF": b"\n", "CRLF": b"\r\n", "CR": b"\r"}
SPLINE = re.compile(r"COORDSPLINET:\d+,3(,-?\d+){18}")  # what a unit takes
Damage = Callable[[bytes], bytes]


def motion(rng: random.Random) -> str:
    values = ",".join(str(rng.randint(-900, 900)) for _ in range(18))
    return f"COORDSPLINET:100,3,{values}"


def session(rng: random.Random, motions: int = 8) -> list[str]:
    """Motion lines with a poll now and then."""
    lines = []
    for _ in range(motions):
        lines.append(motion(rng))
        if rng.random() < 0.5:
            lines += ["COORDAP?", "ST?"]
    return [*lines, "STAMP:77"]


def answers(line: str) -> bytes:
    known = {"COORDAP?": "COORDAP=123,4,5,-181650,-349,12,99200,33300,-96500", "ST?": "ST=16"}
    if line.startswith("STAMP:"):
        return f"STAMP={line[6:]}\r\n".encode()
    return f"{known[line]}\r\n".encode() if line in known else b""


class EchoingUnit:
    """Lines in, echo and answers out; what it obeys is kept."""

    def __init__(self, end: str = "LF", answer_first: bool = False, spoil: Damage = bytes) -> None:
        self.end = ENDS[end]
        self.answer_first = answer_first
        self.spoil = spoil  # what happens to an answer
        self.obeyed: list[str] = []
        self.rest = b""

    def take(self, data: bytes) -> bytes:
        out = b""
        *lines, self.rest = (self.rest + data).split(b"\n")
        for line in lines:
            text = line.decode("latin-1")
            self.obeyed.append(text)
            echo, answer = line + self.end, self.spoil(answers(text))
            out += answer + echo if self.answer_first else echo + answer
        return out


def feed(watch: EchoWatch, data: bytes, at_s: float = 0.0) -> list[str]:
    """What a link makes of received bytes."""
    taken = [watch.take(line.text, at_s, line.torn) for line in LineSplitter(512).take(data)]
    return [t for t in taken if t is not None]


def talk(
    lines: Sequence[str], unit: EchoingUnit, there: Damage = bytes, back: Damage = bytes
) -> tuple[EchoWatch, dict[int, str], list[str]]:
    """Everything sent, then everything received; the numbers of the lines, and the answers."""
    watch = EchoWatch()
    watch.resume()
    numbers = {watch.sent(line, 0.0): line for line in lines}
    data = there("".join(f"{line}\n" for line in lines).encode())
    return watch, numbers, feed(watch, back(unit.take(data)))
