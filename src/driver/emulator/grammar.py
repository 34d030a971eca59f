"""What a received line says: ``NAME[axis]:v,..`` or ``NAME[axis]?``, read the way the unit does, without errors."""

from __future__ import annotations

import re
from dataclasses import dataclass

AXES = "ABCDEFGH"
WITHOUT_AXIS = (
    *("ECHO", "VER", "STAMP", "ST", "IDLEREL", "DIGI1", "REGPWRON", "REGPWRFLG", "COORDAP", "COORDGRP"),
    *("COORDDISCONT", "COORDMV", "COORDMVT", "COORDRELMVT", "COORDSPLINET"),
)
WITH_OR_WITHOUT_AXIS = ("R", "STOP", "RELEASE", "PURGE")
WITH_AXIS = (
    *("AP", "G", "HH", "SPD", "SPDT", "PWM", "ANAXSETUP", "REGMS", "REGACC", "REGME", "REGCFG"),
    *("REGP", "REGI", "REGD", "REGS1", "REGS2", "REGTYPE", "REGMODE"),
)

_LINE = re.compile(rb"([A-Z][A-Z0-9]*)(\?:?|:)(.*)")
_NUMBER = re.compile(r"[+-]?[0-9]{1,12}(?:\.[0-9]*)?", re.ASCII)


@dataclass(frozen=True)
class Request:
    """One understood line.

    Attributes:
        name: of the command.
        axis: letter, or "".
        asked: it ends in a question mark.
        text: what stands behind the colon.
    """

    name: str
    axis: str
    asked: bool
    text: str

    def numbers(self, whole: bool = True) -> list[int] | None:
        """The values; None if one is no number, or not of 32 bits.

        Args:
            whole: a decimal point makes it no number; without, what is behind the point is cut off.
        """
        found: list[int] = []
        for part in self.text.split(","):
            if not _NUMBER.fullmatch(part.strip()) or (whole and "." in part):
                return None
            value = int(part.split(".")[0].strip())
            if not -(2**31) <= value < 2**31:
                return None
            found.append(value)
        return found


def parse_request(line: bytes) -> Request | None:
    """What a line (without its end) says; None if that is no command of the unit."""
    match = _LINE.fullmatch(line.strip(b" \r\0"))
    if match is None:
        return None
    word, mark = match[1].decode("ascii"), match[2]
    text = match[3].decode("latin-1")
    if word in WITHOUT_AXIS or word in WITH_OR_WITHOUT_AXIS:
        return Request(word, "", mark != b":", text)
    name, axis = word[:-1], word[-1]
    if axis in AXES and name in WITH_OR_WITHOUT_AXIS + WITH_AXIS:
        return Request(name, axis, mark != b":", text)
    return None
