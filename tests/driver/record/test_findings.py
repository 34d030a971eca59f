"""What a recording tells: of real numbers, in its own words."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from arm.controller.unit import load_unit
from driver.emulator import EmulatorOptions
from driver.line.link import ANSWER_S
from driver.record import findings
from driver.record.findings import Found
from driver.record.unit_record import UnitRecord
from recorded.units import answering, changed, recorded_unit

UNIT = load_unit("crs93")


@cache
def good() -> UnitRecord:
    return recorded_unit().record


def of(record: UnitRecord) -> Found:
    return Found(record, UNIT)


@pytest.mark.parametrize("latency_ms", [0.0, 30.0, 400.0])
def test_the_time_of_an_answer_is_that_of_the_unit(latency_ms: float) -> None:
    record = recorded_unit(EmulatorOptions(reply_delay_ms=latency_ms)).record
    said, agrees = findings.in_time(of(record))
    median_ms = float(said.split()[1])
    assert latency_ms + 8.0 < median_ms < latency_ms + 16.0, "with about 20 bytes at 19200 baud"
    assert agrees


@pytest.mark.parametrize(("late_s", "agrees"), [(ANSWER_S - 0.1, True), (ANSWER_S + 0.1, False)])
def test_an_answer_that_comes_later_than_the_driver_waits_is_late(late_s: float, agrees: bool) -> None:
    events = list(good().events)
    begin = next(i for i, event in enumerate(events) if event.data == "answer times")
    sent, came = (
        next(i for i, e in enumerate(events) if i > begin and e.kind == k) for k in ("sent", "received")
    )
    events[came] = replace(events[came], time_s=events[sent].time_s + late_s)
    said, found = findings.in_time(of(replace(good(), events=tuple(events))))
    assert f"longest {1e3 * late_s:.0f} ms" in said
    assert found is agrees


@pytest.mark.parametrize(("change", "agrees"), [(0, True), (2, True), (3, False), (-3, False)])
def test_a_change_of_counts_at_rest_is_measured(change: int, agrees: bool) -> None:
    def moved(text: str) -> str:
        return text.replace("APB=0\r", f"APB={change}\r")

    said, found = findings.still(of(changed(good(), "rest", "", moved, most=1)))
    assert f"B {abs(change)} ({abs(change)})" in said
    assert found is agrees


def test_a_drift_shows_in_the_range_only() -> None:
    count = iter(range(100))

    def drifting(text: str) -> str:
        return f"APC={next(count)}\r\n" if text.startswith("APC=") else text

    said, agrees = findings.still(of(changed(good(), "rest", "", drifting)))
    readings = next(count)
    assert readings > 5
    assert f"C 1 ({readings - 1})" in said
    assert agrees


@pytest.mark.parametrize(("change", "agrees"), [(49, True), (50, False)])
def test_jaws_at_rest(change: int, agrees: bool) -> None:
    def moved(text: str) -> str:
        return text.replace("APG=840", f"APG={840 - change}")

    assert findings.jaws(of(changed(good(), "rest", "", moved, most=1))) == (
        f"G {change} ({change}), H 0 (0); in brackets the range",
        agrees,
    )


@pytest.mark.parametrize(("rate", "agrees"), [(1.0, True), (5.0, True), (0.9, False), (20.0, False)])
def test_the_rate_of_the_units_clock_over_its_wrap(rate: float, agrees: bool) -> None:
    record = answering(good(), "COORDAP?", "")
    times = [event.time_s for event in good().events if event.data == "APA?\n"]
    events = list(record.events)
    for time_s in times:
        ms = round(1e3 * rate * (time_s - times[len(times) // 2])) % 65_536  # wraps in the middle
        place = next(i for i, e in enumerate(events) if e.data == "APA?\n" and e.time_s == time_s)
        events[place + 1 : place + 1] = [
            type(events[0])(time_s, "received", f"COORDAP={ms},0,0,0,0,0,0,0,0\r\n")
        ]
    found = findings.clock(of(UnitRecord(2.0, record.ended, record.manners, tuple(events))))
    assert found is not None
    assert float(found[0].split()[0]) == pytest.approx(rate, rel=2e-2)
    assert found[1] is agrees


def test_without_a_group_the_clock_is_not_told() -> None:
    assert findings.clock(of(good())) is None


@pytest.mark.parametrize(
    ("g", "h", "agrees"), [("840", "0", True), ("0", "77", True), ("0", "0", None), ("5", "6", None)]
)
def test_the_axis_of_the_gripper(g: str, h: str, agrees: bool | None) -> None:
    record = changed(good(), "questions", "APG?", lambda text: text.replace("840", g))
    record = changed(record, "questions", "APH?", lambda text: text.replace("=0", f"={h}"))
    assert findings.gripper(of(record)) == (f"APG {g}, APH {h}", agrees)


def test_registers_are_listed_as_they_read() -> None:
    record = recorded_unit(EmulatorOptions(registers_readable=True)).record
    said, agrees = findings.registers(of(record))
    assert said.startswith("13 read: REGMSA=7680, REGMSB=2048, ")
    assert agrees


def test_queries_at_rest_are_counted() -> None:
    lost = changed(good(), "rest", "", lambda text: "" if text.startswith("APD=") else text, most=2)
    asked = sum(event.data.endswith("?\n") for event in _of_rest(good()))
    assert findings.whole_answers(of(good())) == (f"{asked} of {asked} whole", True)
    assert findings.whole_answers(of(lost)) == (f"{asked - 2} of {asked} whole", False)
    stray = changed(good(), "rest", "", lambda text: f"{text}hello\r\n", most=1)
    assert findings.whole_answers(of(stray)) == (f"{asked} of {asked} whole, 1 other lines", False)
    noise = changed(good(), "rest", "", lambda text: text.replace("APD=0", "AP\x80=0"), most=1)
    assert findings.whole_answers(of(noise)) == (f"{asked - 1} of {asked} whole, 1 other lines", False)


def _of_rest(record: UnitRecord) -> list[object]:
    steps = [i for i, e in enumerate(record.events) if e.kind == "step"]
    begin = next(i for i in steps if record.events[i].data == "rest")
    end = next(i for i in steps if i > begin)
    return [event for event in record.events[begin:end] if event.kind == "sent"]
