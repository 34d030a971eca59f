"""Compare a recording, line by line, with what the code assumes of a unit (docs/sources.md, "Lines and commands").

Each assumption is read from the code that relies on it: its constants and parsers. So a change there changes the row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from arm.controller.unit import Unit
from driver.execution.rest import SAMPLE_S, STILL_COUNTS
from driver.line.link import ANSWER_S
from driver.line.protocol import BUSY
from driver.mars.gripper import STILL_ADC
from driver.record import findings
from driver.record.findings import Finding, Found
from driver.record.unit_record import UnitRecord


@dataclass(frozen=True)
class Row:
    """An assumption and what the recording says of it.

    Attributes:
        name: what it is about.
        assumed: by the code.
        found: in the recording.
        agrees: None: the recording does not tell.
        matters: what goes wrong if it does not hold.
    """

    name: str
    assumed: str
    found: str
    agrees: bool | None
    matters: str


def compare(record: UnitRecord, unit: Unit) -> tuple[Row, ...]:
    """Return a row for every assumption; one that cannot apply to this unit is left out.

    Args:
        record: of the unit.
        unit: any known one: firmware and axes are the same for all.
    """
    return tuple(_rows(Found(record, unit)))


def _rows(found: Found) -> Iterator[Row]:
    for name, assumed, finding, matters in _ASSUMPTIONS:
        told = finding(found)
        if told is not None:
            said = assumed.format(firmware=found.unit.firmware, axes=" ".join(found.unit.axes))
            yield Row(name, said, told[0], told[1], matters)


_A, _M = ANSWER_S, STILL_COUNTS
_ASSUMPTIONS: tuple[tuple[str, str, Callable[[Found], Finding | None], str], ...] = (
    (
        "line",
        "nothing comes before anything is sent",
        findings.unasked,
        "lines that nobody asked for can hide answers",
    ),
    ("time", f"an answer within {_A:g} s", findings.in_time, "every wait for an answer gives up then"),
    (
        "place",
        "an answer begins its line; there is no prompt",
        findings.column,
        "no answer would be recognised",
    ),
    (
        "line end",
        "answers end in CR LF",
        findings.line_end,
        "the driver takes CR, LF or both; tell the maintainers",
    ),
    (
        "order",
        "stamps are answered in the order sent",
        findings.in_order,
        "a stamp would not prove what was executed",
    ),
    (
        "command",
        "a command has no answer",
        findings.silent_command,
        "answers would be taken for those of queries",
    ),
    (
        "name",
        "VER begins with {firmware}",
        findings.identification,
        "the unit is refused: other units of speed",
    ),
    (
        "echo off",
        "nothing is echoed after ECHO:0",
        findings.no_echo,
        "an adapter echoes: damage is not noticed",
    ),
    (
        "echo on",
        "every line is echoed whole after ECHO:1",
        findings.echo,
        "damaged lines show late; jog is refused",
    ),
    (
        "manners",
        "the driver finds the same echo at its opening",
        findings.measured,
        "it would trust a wrong echo",
    ),
    (
        "unknown",
        "an unknown query has no answer",
        findings.unknown_query,
        "FAIL! would end a wait for a motion",
    ),
    (
        "status",
        "ST is a whole number below 2^18",
        findings.status,
        "faults are not seen; every command stops",
    ),
    (
        "at rest",
        f"bit {BUSY.bit_length() - 1} of ST is 0",
        findings.idle,
        "the arm would never count as at rest",
    ),
    ("axes", "{axes} answer AP, by whole numbers of 24 bits", findings.axes, "positions cannot be read"),
    (
        "gripper",
        "of G and H one reads other than 0",
        findings.gripper,
        "before set-up it may read 0: record again later",
    ),
    (
        "group",
        "COORDAP: silent, or ms, segment, parameter, counts",
        findings.group,
        "motions cannot be watched",
    ),
    (
        "clock",
        "COORDAP counts ms at a steady rate",
        findings.clock,
        "a power cycle is not noticed, or one is reported",
    ),
    (
        "registers",
        "those that are answered are numbers",
        findings.registers,
        "a wrong register is not noticed",
    ),
    (
        "noise",
        f"counts at rest change by at most {_M} in {SAMPLE_S:g} s",
        findings.still,
        "the arm never counts as at rest; or the line damaged a number",
    ),
    (
        "jaws",
        f"at rest they change by less than {STILL_ADC}",
        findings.jaws,
        "the jaws never count as at rest; or the line damaged a number",
    ),
    (
        "answers",
        "every query at rest is answered, whole",
        findings.whole_answers,
        "a noisy line: see docs/faults.md",
    ),
)
