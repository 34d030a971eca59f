"""The lines that `a465 record` may send. None of them moves anything, and only ECHO changes anything: the echo itself.

A line without a colon cannot set anything, even if it arrives damaged. The two with a colon, ECHO and STAMP, are those
that every program sends before it knows what is there (`driver.line.protocol.HARMLESS`).
"""

from __future__ import annotations

import re

from driver.line.protocol import COMMANDS, STAMP_RANGE

AXES = "ABCDEFGH"
UNKNOWN = "NOSUCH?"  # a query that no unit has: how it answers what it does not know
HELP = "help"  # the successor LX_RoCoN lists its commands; a line without a mark is no command
_QUERIES = frozenset(
    f"{name}{axis}?"
    for name, command in COMMANDS.items()
    if command.asked is not False
    for axis in (AXES if command.axis == "x" else ("",))
)
_ECHO_OR_STAMP = re.compile(r"ECHO:[01]|STAMP:(\d{1,5})")


def is_question(line: str) -> bool:
    """Whether a line (without its end) is one of those that may be sent; the empty line is."""
    if line in _QUERIES or line in ("", UNKNOWN, HELP):
        return True
    found = _ECHO_OR_STAMP.fullmatch(line)
    return found is not None and int(found[1] or 0) < STAMP_RANGE


def register_kinds() -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Names of the registers that a unit may answer for, each with its axes, or with "" if it has none."""
    kinds = ((name, c) for name, c in COMMANDS.items() if c.values is not None and c.asked is not False)
    return tuple((name, tuple(AXES) if command.axis == "x" else ("",)) for name, command in kinds)
