"""The MARS-8 line protocol: a table of commands, and pure functions that encode and parse lines.

``NAME[axis]:v,v..`` is a command and ``NAME[axis]?`` a query; both end in a line feed. A successful command has no
answer. An answer is ``NAME[axis]=value`` and CR LF. Source: docs/sources.md, "Lines and commands" and
"Coordinated motion". Evidence: D documented by the vendor, C client code, U records from a unit, I inferred.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from arm.controller.segments import Segment
from arm.errors import ExecutionStopped, InputError

BAUD = 19200
BYTES_PER_SECOND = BAUD / 10.0  # 8N1: ten bits a byte
MAX_LINE = 149  # characters; the longest line known to work has about 150 [I]
VERTEX_STEPS = 5  # COORDDISCONT in acceleration steps of 1 ms: "best performance" of the vendor's toolbox [D]
STAMP_RANGE = 0x8000  # a stamp is 0 .. 0x7FFF
SEQUENCE_RANGE = 0x8000  # segment numbers are compared modulo this: right for a wrap at 2^15 and at 2^16
CLOCK_RANGE_MS = 0x10000  # COORDAP's milliseconds wrap here [D]
_INT32 = 2**31


@dataclass(frozen=True)
class Command:
    """One row of the command table.

    Attributes:
        axis: whether the name takes an axis letter: "" never, "x" always, "?" optionally.
        values: lowest and highest number of values; None for a query only.
        asked: whether ``NAME?`` is answered (None: unknown, never relied upon).
        evidence: D, C, U, I.
    """

    axis: str
    values: tuple[int, int] | None
    asked: bool | None
    evidence: str


# Names are case-sensitive. A comment gives the meaning, the unit of the values, and the form of an answer.
COMMANDS = {
    "ECHO": Command("", (1, 1), False, "CU"),  # 0 or 1: send received characters back; on after power-up
    "VER": Command("", None, True, "CU"),  # firmware: VER=<text>
    "STAMP": Command("", (1, 1), False, "C"),  # 0 to 32767, answered in order of commands: STAMP=n
    "ST": Command("", None, True, "C"),  # status word: ST=<decimal>
    "R": Command("?", (0, 0), False, "C"),  # R!, Rx! or FAIL! once nothing generates motion
    "AP": Command("x", None, True, "C"),  # actual position of an axis, counts: APx=<int>
    "COORDAP": Command("", None, True, "D"),  # positions of the group, counts: COORDAP=ms,seg,par,p..
    "STOP": Command("?", (0, 0), False, "U"),  # stop, stay powered and hold
    "RELEASE": Command("?", (0, 0), False, "DU"),  # no current; brakes engage, the arm may drop
    "PURGE": Command("?", (0, 0), False, "DC"),  # stop any action and clear errors
    "HH": Command("x", (0, 0), False, "C"),  # hard home: go to the mark, position 0 there
    "G": Command("x", (1, 1), False, "C"),  # go to a position, counts, this axis alone
    "SPDT": Command("x", (2, 2), False, "DI"),  # speed, counts/256 per ms, for a time, ms; closes the loop
    "REGMS": Command("x", (1, 1), None, "DCU"),  # speed limit, counts/256 per ms
    "REGACC": Command("x", (1, 1), None, "C"),  # acceleration limit, counts/256 per ms^2 (unit assumed)
    "REGME": Command("x", (1, 1), None, "C"),  # energy limit; 32000 is 24 V
    "REGCFG": Command("x", (1, 1), None, "CI"),  # axis configuration and homing speed, bits
    "REGP": Command("x", (1, 1), None, "C"),  # proportional gain
    "REGI": Command("x", (1, 1), None, "C"),  # integral gain
    "REGD": Command("x", (1, 1), None, "C"),  # derivative gain
    "REGS1": Command("x", (1, 1), None, "C"),  # current limit
    "REGS2": Command("x", (1, 1), None, "C"),  # overcurrent feedback
    "ANAXSETUP": Command("x", (2, 2), False, "C"),  # feed an axis by an ADC channel: position, current
    "IDLEREL": Command("", (1, 1), None, "CI"),  # release the arm after idling, s (assumed); 0 is never
    "COORDGRP": Command("", (0, 8), False, "C"),  # axis letters: form the coordinated group, or dissolve it
    "COORDDISCONT": Command("", (1, 1), None, "DC"),  # speed jump allowed at a vertex, acceleration steps
    "COORDMV": Command("", (1, 8), False, "D"),  # straight to a position, counts, in the shortest time
    "COORDMVT": Command("", (2, 9), False, "D"),  # the same in at least that time: ms, counts
    "COORDSPLINET": Command("", (3, 40), False, "DC"),  # polynomial: ms, order, counts axis by axis
}

# May be sent before the other side is identified: none of these moves or changes anything.
HARMLESS = frozenset({"ECHO", "STAMP", "VER"})


def encode(name: str, *values: int | str, axis: str = "") -> str:
    """Return the line (without its end) of a command such as ``REGMSA:7680``.

    Raises:
        InputError: the command is unknown, the axis or the number of values is wrong, a value is not a 32-bit integer
            (axis letters for COORDGRP), or the line is longer than MAX_LINE.
    """
    command = _command(name, axis)
    if command.values is None:
        raise InputError(f"{name} can only be asked, not set", command=name)
    least, most = command.values
    if not least <= len(values) <= most:
        why = f"{name}: {len(values)} values, must be {least} to {most}"
        raise InputError(why, command=name, values=list(values))
    for value in values:
        if isinstance(value, str):
            if name != "COORDGRP" or not _is_axis(value):
                raise InputError(f"{name} value {value!r}: must be a whole number", command=name, value=value)
        elif isinstance(value, bool) or int(value) != value or not -_INT32 <= value < _INT32:
            why = f"{name} value {value}: must be a 32-bit whole number"
            raise InputError(why, command=name, value=value)
    line = f"{name}{axis}:" + ",".join(v if isinstance(v, str) else str(int(v)) for v in values)
    if len(line) > MAX_LINE:
        why = f"{name} line of {len(line)} characters: must be at most {MAX_LINE}; use shorter segments"
        raise InputError(why, command=name, line=line)
    return line


def encode_query(name: str, axis: str = "") -> str:
    """Return the line (without its end) of a query such as ``ST?`` or ``APG?``.

    Raises:
        InputError: the command is unknown, cannot be asked, or the axis is wrong.
    """
    if _command(name, axis).asked is False:
        raise InputError(f"{name} cannot be asked", command=name)
    return f"{name}{axis}?"


def encode_segment(segment: Segment, end: Sequence[int]) -> str:
    """Return the line of one segment that ends at absolute counts `end` (6,).

    A polynomial is sent as COORDSPLINET, relative to the end of the segment before; a straight segment as COORDMVT,
    which is absolute and shorter.

    Raises:
        InputError: a duration below 1 ms, an order above 3, or the line is too long.
    """
    order = len(segment.coefficients)
    if segment.duration_ms < 1 or not 1 <= order <= 3:
        why = (
            f"segment of {segment.duration_ms} ms and order {order}: must have at least 1 ms and order 1 to 3"
        )
        raise InputError(why, duration_ms=segment.duration_ms, order=order)
    if order == 1:
        return encode("COORDMVT", segment.duration_ms, *(int(c) for c in end))
    by_axis = [int(a) for axis in zip(*segment.coefficients, strict=True) for a in axis]
    return encode("COORDSPLINET", segment.duration_ms, order, *by_axis)


def encode_dwell(duration_ms: int, axes: int) -> str:
    """Return a zero-length timed cubic: the arm waits at rest while segments are loaded behind it [C]."""
    return encode("COORDSPLINET", duration_ms, 3, *([0] * (3 * axes)))


def _command(name: str, axis: str) -> Command:
    command = COMMANDS.get(name)
    if command is None:
        why = f"{name!r} is not a command of the MARS-8; must be one of {', '.join(COMMANDS)}"
        raise InputError(why, command=name)
    if (axis and not _is_axis(axis)) or (axis and not command.axis) or (command.axis == "x" and not axis):
        rules = {"": "takes no axis", "x": "needs an axis A to H", "?": "may take an axis A to H"}
        raise InputError(f"{name}{axis}: {rules[command.axis]}", command=name, axis=axis)
    return command


def _is_axis(text: str) -> bool:
    return len(text) == 1 and "A" <= text <= "H"


@dataclass(frozen=True)
class Answer:
    """``key=text``, the answer to a query or a stamp."""

    key: str
    text: str


@dataclass(frozen=True)
class Ready:
    """``R!`` or ``Rx!``: the awaited axes no longer generate motion. `axis` is "" for all."""

    axis: str


@dataclass(frozen=True)
class Failed:
    """``FAIL!``: an awaited axis is in error, or arm power is off."""


@dataclass(frozen=True)
class Other:
    """Anything else: noise, or part of a line."""

    text: str


@dataclass(frozen=True)
class Echoed:
    """The echo of a line, or a damaged line; `driver.line.echo` has judged it."""

    text: str


Reply = Answer | Ready | Failed | Other | Echoed

_ANSWER = re.compile(r"([A-Z][A-Z0-9]*)=(.*)")
_READY = re.compile(r"R([A-H]?)!")


def parse_reply(line: str) -> Reply:
    """Classify one received line (without its end). Never raises: anything unknown is `Other`."""
    if match := _ANSWER.fullmatch(line):
        return Answer(match[1], match[2])
    if match := _READY.fullmatch(line):
        return Ready(match[1])
    return Failed() if line == "FAIL!" else Other(line)


# Bits of the status word: docs/sources.md, "Status word and recovery".
AXIS_ERROR, BUSY, NO_ROOM, ARM_POWER_OFF, MOTION_STOP = 0x8, 0x10, 0x80, 0x10000, 0x20000
FAULTS = {
    AXIS_ERROR: "an axis is in error",
    ARM_POWER_OFF: "arm power is off",
    MOTION_STOP: "motion stop is pressed",
}
"""States that forbid motion."""


@dataclass(frozen=True)
class Status:
    """The status word. Bits are tested one by one, as unknown ones may be set."""

    word: int

    @property
    def busy(self) -> bool:
        """Whether an axis still generates motion."""
        return bool(self.word & BUSY)

    @property
    def fault(self) -> bool:
        """Whether any of the states that forbid motion is present."""
        return bool(self.faults())

    def faults(self) -> tuple[str, ...]:
        """Name the faults; empty if there is none."""
        return tuple(text for bit, text in FAULTS.items() if self.word & bit)

    def remedy(self) -> str:
        """Say how to clear the faults (docs/sources.md, "Status word and recovery")."""
        return (
            "find what stopped the axis and make sure that nothing touches it; press Motion Stop, then Arm Power"
            if self.word & AXIS_ERROR
            else "unlock the emergency stop, close the cage, press Motion Stop, then Arm Power"
        )


@dataclass(frozen=True)
class Position:
    """One answer to COORDAP.

    Attributes:
        time_ms: the unit's clock, modulo CLOCK_RANGE_MS.
        segment: number of the segment being executed; wraps at 2^15 or 2^16 (unknown which).
        parameter: progress inside the segment, scale unknown; above 0 only while moving [C].
        counts: actual positions in the group's order.
    """

    time_ms: int
    segment: int
    parameter: int
    counts: tuple[int, ...]


class MalformedAnswer(ExecutionStopped):
    """An answer that arrived damaged: bytes lost or changed on the line."""


def parse_integer(text: str) -> int:
    """Parse a decimal integer.

    Raises:
        MalformedAnswer: not an integer, or more than 12 digits.
    """
    if not re.fullmatch(r"[+-]?[0-9]{1,12}", text):
        raise MalformedAnswer(f"{text[:40]!r} is not a whole number")
    return int(text)


def parse_status(text: str) -> Status:
    """Parse the value of ST.

    Raises:
        MalformedAnswer: not an integer from 0 to below 2^18.
    """
    word = parse_integer(text)
    if not 0 <= word < 2**18:
        raise MalformedAnswer(f"status {word}: must be from 0 to below 2^18")
    return Status(word)


def parse_position(text: str, axes: int) -> Position:
    """Parse the value of COORDAP for a group of that many axes.

    Raises:
        MalformedAnswer: other than 3 + axes integers, or a position beyond the unit's 24 bits.
    """
    values = [parse_integer(v) for v in text.split(",")]
    if len(values) != 3 + axes:
        raise MalformedAnswer(f"COORDAP has {len(values)} values, must be {3 + axes}")
    if any(not -(2**23) <= v < 2**23 for v in values[3:]):
        raise MalformedAnswer(f"COORDAP positions {values[3:]}: must be 24-bit integers")
    return Position(values[0], values[1], values[2], tuple(values[3:]))
