"""What may be sent to an unknown unit moves and sets nothing, also if bytes are lost on the way."""

from __future__ import annotations

import itertools
import re

import pytest

from driver.emulator import EmulatorOptions
from driver.line.protocol import COMMANDS, HARMLESS
from driver.record.questions import AXES, HELP, UNKNOWN, is_question, register_kinds
from recorded.units import recorded_unit

SETS = re.compile(r"([A-Z][A-Z0-9]*?)([A-H]?):.*")


def sets_something(line: str) -> bool:
    """Whether a line is a command other than ECHO and STAMP, by the table of commands."""
    found = SETS.fullmatch(line)
    names = () if found is None else (found[1], found[1] + found[2])
    return any(
        name in COMMANDS and COMMANDS[name].values is not None and name not in HARMLESS for name in names
    )


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_no_command_of_the_table_is_a_question(name: str) -> None:
    for axis, values in itertools.product(
        ("", *AXES), ("", "0", "1", "5", "300,1", "A,B,C", "0,300", "99999")
    ):
        line = f"{name}{axis}:{values}"
        harmless = (name == "ECHO" and values in ("0", "1") and not axis) or (
            name == "STAMP" and values in ("0", "1", "5") and not axis
        )
        assert is_question(line) == harmless, line


def test_what_may_be_asked() -> None:
    for line in (
        "",
        "VER?",
        "ST?",
        "APA?",
        "APH?",
        "COORDAP?",
        "REGMSG?",
        "IDLEREL?",
        "ECHO:0",
        "STAMP:32767",
    ):
        assert is_question(line), line
    for line in (
        "STOP?",
        "HHA?",
        "GA?",
        "RELEASE?",
        "API?",
        "ver?",
        " VER?",
        "VER?\n",
        "VER?\nSTOP:",
        "STAMP:32768",
    ):
        assert not is_question(line), line
    assert ":" not in HELP + UNKNOWN
    kinds = dict(register_kinds())
    assert kinds["REGMS"] == tuple(AXES)
    assert kinds["IDLEREL"] == ("",)
    assert not {"VER", "ST", "AP", "COORDAP", "STOP", "ECHO"} & set(kinds)


def test_no_loss_of_bytes_makes_a_question_a_command() -> None:
    """Of one line, or of two that a unit gets together: any bytes in a row are lost, the line end between them too."""
    record = recorded_unit().record
    sent = [event for event in record.events if event.kind == "sent"]
    together = {a.data + b.data for a, b in itertools.pairwise(sent) if b.time_s - a.time_s < 0.02}
    assert len(together) > 5
    for text in {event.data for event in sent} | together:
        for begin, end in itertools.combinations(range(len(text) + 1), 2):
            for line in (text[:begin] + text[end:]).split("\n"):
                assert not sets_something(line), (text, line)


def test_lines_with_and_without_a_colon_never_come_together() -> None:
    for options in (
        EmulatorOptions(),
        EmulatorOptions(registers_readable=True),
        EmulatorOptions(echo="byte"),
    ):
        events = [e for e in recorded_unit(options).record.events if e.data != "\n" and e.kind != "step"]
        for a, b in itertools.pairwise(events):
            if a.kind == b.kind == "sent" and (":" in a.data) != (":" in b.data):
                assert b.time_s - a.time_s >= 0.4, (a, b)


def test_the_search_for_commands_finds_them() -> None:
    assert all(map(sets_something, ("STOP:", "HHA:", "REGMSA:5", "COORDMV:1,2", "R:", "RG:", "SPDTB:0,300")))
    assert not any(map(sets_something, ("ST:5", "VER:1", "ECHO:1", "STAMP:7", "REGMSA?", "S:5", "")))
