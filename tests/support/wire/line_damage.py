"""Damage to a line in memory: one line of a motion, all bytes for a while, or single bits, there or on the way back."""

from __future__ import annotations

import random
import re
from dataclasses import dataclass, field
from typing import Literal

Kind = Literal["lost", "doubled", "cut", "digit", "joined", "bit", "0.3 s", "0.5 s", "1.0 s"]
KINDS: tuple[Kind, ...] = ("lost", "doubled", "cut", "digit", "joined", "bit", "0.3 s", "0.5 s", "1.0 s")
SEGMENT = re.compile(rb"COORDSPLINET:\d+,3(?!(,0){18}\D)|COORDMVT:")  # no dwell
ANSWER = re.compile(rb"(COORDAP|ST|STAMP)=")


@dataclass
class Damage:
    """A tap for `driver.emulator.line.memory.MemoryLine`. Nothing is damaged before `armed`.

    Args:
        kind: of damage.
        nth: the how manieth line that matches, from 1.
        seed: of the place in it.
        stops: so many STOPs are lost after it.
        what: which lines count.

    Attributes:
        at_s: when it happened.
        line: the line that was damaged, as far as it is known.
    """

    kind: Kind
    nth: int
    seed: int
    stops: int = 0
    what: re.Pattern[bytes] = SEGMENT
    armed: bool = False
    at_s: float | None = None
    line: bytes = b""
    _seen: int = 0
    _rest: bytes = b""
    _left: int = field(default=0)
    _until: float = -1.0

    def __call__(self, now_s: float, data: bytes) -> bytes:
        """What goes on of bytes that pass."""
        if not self.armed:
            return data
        if now_s < self._until:
            return b""
        if self.at_s is not None and self._left and b"STOP:" in data:
            self._left -= 1
            return data.replace(b"STOP:\n", b"")
        if self.at_s is not None and not self._rest:
            return data
        whole = self._rest + data
        if not self._rest and not self.what.match(data):
            return data
        if b"\n" not in whole:
            if not self._rest:
                self._seen += 1
            if self._seen == self.nth:
                self._rest = whole  # held back until the line is whole: the damage needs all of it
                return b""
            return data
        if not self._rest:
            self._seen += 1
            if self._seen != self.nth:
                return data
        self._rest = b""
        return self._spoil(now_s, whole)

    def _spoil(self, now_s: float, data: bytes) -> bytes:
        rng = random.Random(self.seed)
        self.at_s, self._left = now_s, self.stops
        line, end, after = data.partition(b"\n")
        self.line = line
        at = rng.randrange(1, max(len(line), 2))
        match self.kind:
            case "lost":
                return after
            case "doubled":
                return line + end + line + end + after
            case "cut":
                return line[:at] + end + after
            case "joined":
                return line + after
            case "bit":
                return line[:at] + bytes([line[at] ^ 1 << rng.randrange(7)]) + line[at + 1 :] + end + after
            case "digit":
                digits = [i for i in range(len(line)) if line[i : i + 1].isdigit()]
                i = rng.choice(digits)
                other = rng.choice([d for d in b"0123456789" if d != line[i]])
                return line[:i] + bytes([other]) + line[i + 1 :] + end + after
        self._until = now_s + float(self.kind.split()[0])
        return line[:at]


class BitErrors:
    """A tap that turns one bit of a byte round at random. Nothing is damaged before `armed`.

    Args:
        rate: of bytes.
        seed: of which.

    Attributes:
        bytes, errors: that passed while it was armed.
    """

    def __init__(self, rate: float, seed: int) -> None:
        self.rate = rate
        self.armed = False
        self.bytes = self.errors = 0
        self._rng = random.Random(seed)

    def __call__(self, now_s: float, data: bytes) -> bytes:
        """What goes on of bytes that pass."""
        if not self.armed:
            return data
        out = bytearray(data)
        for i in range(len(out)):
            if self._rng.random() < self.rate:
                out[i] ^= 1 << self._rng.randrange(8)
                self.errors += 1
        self.bytes += len(out)
        return bytes(out)
