"""The table: each row falls if what it assumes does not hold, and no other row does."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import pytest

from arm.controller.unit import load_unit
from driver.emulator import EmulatorOptions
from driver.record.assumptions import Row, compare
from driver.record.tape import Event
from driver.record.unit_record import UnitRecord
from recorded.units import answering, changed, recorded_unit

UNIT = load_unit("crs93")
Change = Callable[[UnitRecord], UnitRecord]


@cache
def good(grouped: bool = False) -> UnitRecord:
    if not grouped:
        return recorded_unit().record
    form = lambda emulator, line, clock: emulator.interpreter.take("COORDGRP:A,B,C,D,E,F")  # noqa: E731
    return recorded_unit(prepare=form).record


def table(record: UnitRecord) -> dict[str, Row]:
    return {row.name: row for row in compare(record, UNIT)}


def at(step: str, line: str, old: str, new: str, most: int = 1000) -> Change:
    return lambda record: changed(record, step, line, lambda text: text.replace(old, new), most)


def swapped(record: UnitRecord) -> UnitRecord:
    """The first two answers of the burst, in the other order."""
    events = list(record.events)
    begin = next(i for i, e in enumerate(events) if e.data == "burst, echo off")
    a, b = [i for i, e in enumerate(events) if i > begin and e.kind == "received"][:2]
    events[a], events[b] = replace(events[a], data=events[b].data), replace(events[b], data=events[a].data)
    return replace(record, events=tuple(events))


def early(record: UnitRecord) -> UnitRecord:
    return replace(record, events=(record.events[0], Event(0.4, "received", "hello\r\n"), *record.events[1:]))


def echoed(text: str) -> str:
    return f"{text.replace('=', ':')}{text}"


BREAKS: dict[str, Change] = {
    "line": early,
    "time": at("answer times", "STAMP:", "STAMP=", "ST\x80MP=", most=1),
    "place": at("echo off", "STAMP:", "STAMP=", "> STAMP="),
    "line end": at("echo off", "", "\r\n", "\n"),
    "order": swapped,
    "command": at("echo off", "ECHO:0", "ECHO:0\n", "ECHO:0\nOK\r\n"),
    "name": lambda record: at("echo off", "VER?", "MARS8", "MARS81")(
        at("echo on", "VER?", "MARS8", "MARS81")(record)
    ),
    "echo off": lambda record: changed(record, "echo off", "STAMP:", echoed),
    "echo on": at("echo on", "STAMP:", "STAMP:", "STAMPP:", most=1),
    "manners": lambda record: replace(
        record, manners={"echoes": False, "adapter": False, "takes_turns": False}
    ),
    "unknown": lambda record: answering(record, "NOSUCH?", "FAIL!\r\n"),
    "status": at("questions", "ST?", "ST=0", "ST=262144"),
    "at rest": at("rest", "", "ST=0", "ST=16", most=1),
    "axes": at("questions", "APC?", "APC=0\r\n", ""),
    "gripper": at("questions", "APG?", "840", "0"),
    "group": lambda record: answering(record, "COORDAP?", "COORDAP=1,2\r\n"),
    "registers": lambda record: answering(record, "REGMSA?", "REGMSA=fast\r\n"),
    "noise": at("rest", "", "APB=0", "APB=3", most=1),
    "jaws": at("rest", "", "APG=840", "APG=700", most=1),
    "answers": at("rest", "", "APA=0", "APA=?", most=1),
}


def test_an_emulated_unit_is_as_assumed() -> None:
    for record in (good(), good(grouped=True)):
        assert {name: row.agrees for name, row in table(record).items() if row.agrees is not True} == {}
    assert set(table(good())) == set(BREAKS)
    assert set(table(good(grouped=True))) == {*BREAKS, "clock"}


@pytest.mark.parametrize("name", BREAKS)
def test_a_row_falls_alone(name: str) -> None:
    rows = table(BREAKS[name](good()))
    together = {"echo off": {"manners"}}  # which compares the driver with the bytes
    fallen = {row.name for row in rows.values() if row.agrees is not True}
    assert fallen == {name} | together.get(name, set())
    assert rows[name].agrees is (None if name == "gripper" else False)


def test_a_clock_that_stands_still_falls() -> None:
    stopped = changed(good(grouped=True), "rest", "", lambda text: _with_time(text, 7))
    assert {row.name for row in table(stopped).values() if row.agrees is not True} == {"clock"}


def _with_time(text: str, ms: int) -> str:
    _, comma, tail = text.partition(",")
    return f"COORDAP={ms},{tail}" if text.startswith("COORDAP=") and comma else text


def test_of_a_recording_that_was_cut_every_row_is_known_or_not() -> None:
    """However short it is, nothing raises, and what was recorded whole is told as in the whole recording."""
    whole = table(good())
    for count in range(0, len(good().events), 7):
        for row in table(replace(good(), manners=None, events=good().events[:count])).values():
            assert row.assumed == whole[row.name].assumed
    nothing = table(replace(good(), manners=None, events=()))
    assert {row.agrees for row in nothing.values()} == {None}
    assert {row.found for row in nothing.values()} == {"not recorded"}


@pytest.mark.parametrize(
    ("options", "fallen"),
    [
        (EmulatorOptions(echo="byte", echo_order="mixed"), set()),
        (EmulatorOptions(echo="byte", echo_end="CRLF"), set()),
        (EmulatorOptions(echo_order="after", registers_readable=True, noise=b"\xff\x00abc"), set()),
        (EmulatorOptions(echo="none"), {"echo on"}),
        (EmulatorOptions(adapter_echo=True), {"echo on", "echo off"}),
        (EmulatorOptions(unknown="fail"), {"unknown", "group"}),
    ],
)
def test_units_of_other_kinds(options: EmulatorOptions, fallen: set[str]) -> None:
    rows = table(recorded_unit(options).record)
    assert {row.name for row in rows.values() if row.agrees is not True} == fallen


def test_every_row_says_what_depends_on_it() -> None:
    for row in compare(good(), UNIT):
        assert row.matters
        assert row.assumed
        assert "{" not in row.assumed


@pytest.mark.parametrize("seed", range(20))
def test_whatever_came_there_is_a_table(seed: int) -> None:
    rng = random.Random(seed)
    events = [
        replace(event, data="".join(c for c in event.data if rng.random() < 0.9) + chr(rng.randrange(256)))
        if event.kind == "received" and rng.random() < 0.5
        else event
        for event in good(grouped=True).events
        if rng.random() < 0.95
    ]
    assert {row.agrees for row in table(replace(good(), events=tuple(events))).values()} <= {
        True,
        False,
        None,
    }
