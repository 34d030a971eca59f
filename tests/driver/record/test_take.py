"""A unit is recorded: what is sent at the wire, and how it ends when the unit or the line does not behave."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

from arm.controller.unit import load_unit
from arm.errors import A465Error, InputError
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.emulator.line.memory import MemoryLine
from driver.line.link import LinkLost, NoAnswer
from driver.line.stepped_clock import SteppedClock
from driver.record.take import Recorder
from driver.record.unit_record import Ended
from recorded.units import FIRMWARE, Recorded, recorded_unit

OF_ONE_AXIS = ("REGMS", "REGACC", "REGME", "REGCFG", "REGP", "REGI", "REGD", "REGS1", "REGS2")
QUERIES = {
    *("VER?", "ST?", "COORDAP?", "IDLEREL?", "COORDDISCONT?", "NOSUCH?", "help"),
    *(f"AP{axis}?" for axis in "ABCDEFGH"),
    *(f"{name}{axis}?" for name in OF_ONE_AXIS for axis in "ABCDEFGH"),
}  # written out, so that a command that slips into the table of questions shows here
MOST_S = 150.0  # of the unit's time, for a recording of 2 s at rest
UNITS: dict[str, dict[str, Any]] = {
    "as assumed": {},
    "silent about its echo": {"echo": "none"},
    "byte by byte": {"echo": "byte"},
    "interleaved": {"echo": "byte", "echo_order": "mixed", "echo_end": "CRLF"},
    "after its answers": {"echo_order": "after", "echo_end": "CR"},
    "adapter": {"adapter_echo": True},
    "registers": {"registers_readable": True},
    "fails": {"unknown": "fail"},
    "noise": {"noise": b"\xff\x00\x80MARS"},
    "slow": {"parse_ms": 40.0, "reply_delay_ms": 300.0},
    "small buffer": {"input_buffer": 16},
    "another": {"version": "LX_ROCON 2"},
    "drifting": {"faults": (Fault("drift", axis="B", counts_per_s=100.0, most_counts=5000),)},
}


def only_asked(recorded: Recorded) -> bool:
    """Whether a unit received nothing but questions, and nothing has changed there."""
    odd = [
        line for line in recorded.lines if line not in QUERIES and not line.startswith(("STAMP:", "ECHO:"))
    ]
    stamped = all(line.partition(":")[2].isdigit() for line in recorded.lines if line.startswith("STAMP:"))
    echoed = {line for line in recorded.lines if line.startswith("ECHO:")} <= {"ECHO:0", "ECHO:1"}
    return not odd and stamped and echoed and recorded.unharmed


@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_receives_only_questions_whatever_it_is_like(unit: str) -> None:
    recorded = recorded_unit(EmulatorOptions(**UNITS[unit]))
    if unit == "drifting":  # the arm creeps by itself
        recorded = Recorded(recorded.record, recorded.error, recorded.lines, recorded.took_s, True)
    assert only_asked(recorded)
    assert recorded.took_s < MOST_S
    assert recorded.record.ended == (Ended.UNIDENTIFIED if unit == "another" else Ended.COMPLETE)
    received = "".join(event.data for event in recorded.record.events if event.kind == "received")
    assert received.count("STAMP=") >= 20


def test_the_bytes_of_the_recording_are_those_at_the_wire() -> None:
    wires: list[MemoryLine] = []
    recorded = recorded_unit(
        EmulatorOptions(echo="byte", echo_order="mixed"),
        prepare=lambda emulator, line, clock: wires.append(line),
    )
    for kind, passed in (("sent", wires[0].sent), ("received", wires[0].received)):
        kept = [
            (event.time_s, event.data.encode("latin-1"))
            for event in recorded.record.events
            if event.kind == kind
        ]
        assert kept == [(round(at, 6), data) for at, data in passed]
    assert [event.data for event in recorded.record.events if event.kind == "step"] == [
        *("before", "as found", "echo on", "burst, echo on", "echo off", "burst, echo off", "answer times"),
        *("identification", "questions", "rest", "help", "end"),
    ]


def test_a_unit_that_is_not_identified_gets_echo_stamp_and_ver_alone() -> None:
    recorded = recorded_unit(EmulatorOptions(version="LX_ROCON 2"))
    assert {line.partition(":")[0] for line in recorded.lines} == {"ECHO", "STAMP", "VER?"}
    assert isinstance(recorded.error, InputError)
    assert "firmware 'LX_ROCON 2' is not MARS8" in str(recorded.error)


@pytest.mark.parametrize("on", [True, False])
def test_the_echo_is_left_as_it_was_found(on: bool) -> None:
    units: list[Emulator] = []

    def prepare(emulator: Emulator, line: MemoryLine, clock: SteppedClock) -> None:
        emulator.interpreter.echo = on
        units.append(emulator)

    assert only_asked(recorded_unit(prepare=prepare))
    assert units[0].interpreter.echo == on


def test_an_axis_or_register_that_answers_is_read_for_all_axes() -> None:
    lines = recorded_unit(EmulatorOptions(registers_readable=True)).lines
    for axis in "ABCDEF":
        assert f"REGMS{axis}?" in lines
    assert "REGPB?" not in lines, "the first of its kind was not answered"
    assert lines.count("APB?") > 3, "counts are read again and again at rest"


def test_the_counts_are_read_as_long_as_asked() -> None:
    few, many = (recorded_unit(seconds=s).lines.count("APA?") for s in (2.0, 8.0))
    assert 3 * few < many < 5 * few


def test_the_queries_at_rest_are_sent_together_also_to_a_unit_that_interleaves() -> None:
    """With its echo off there are no turns to take."""
    events = recorded_unit(EmulatorOptions(echo="byte", echo_order="mixed")).record.events
    begin = max(event.time_s for event in events if event.data == "ST?\n")
    end = max(event.time_s for event in events if event.data == "APH?\n")
    assert 0.0 <= end - begin < 0.02


# -- units and lines that do not behave


def test_a_unit_that_is_off_is_told_within_ten_seconds() -> None:
    recorded = recorded_unit(to_unit=lambda now, data: b"")
    assert isinstance(recorded.error, InputError)
    assert str(recorded.error) == (
        "port memory line: nothing comes back; is the controller connected and switched on?"
    )
    assert recorded.record.ended == Ended.SILENT
    assert recorded.took_s < 10.0


def test_an_adapter_that_echoes_a_unit_that_is_off_is_no_unit() -> None:
    wire: list[MemoryLine] = []

    def back(now: float, data: bytes) -> bytes:
        wire[0].reply(data)
        return b""

    recorded = recorded_unit(to_unit=back, prepare=lambda emulator, line, clock: wire.append(line))
    assert isinstance(recorded.error, InputError)
    assert "does not answer like a MARS8" in str(recorded.error)
    assert recorded.record.ended == Ended.UNIDENTIFIED
    assert recorded.took_s < MOST_S


@pytest.mark.parametrize("seed", range(4))
def test_garbage_in_place_of_every_answer_ends_in_one_line(seed: int) -> None:
    rng = random.Random(seed)
    recorded = recorded_unit(to_host=lambda now, data: rng.randbytes(len(data)))
    assert recorded.error is not None
    assert "\n" not in str(recorded.error)
    assert recorded.record.ended in (Ended.UNIDENTIFIED, Ended.STOPPED)
    assert only_asked(recorded)
    assert recorded.took_s < MOST_S


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("rate", [0.002, 0.02, 0.1])
def test_a_line_that_loses_bytes_both_ways_is_recorded_or_given_up(seed: int, rate: float) -> None:
    rng = random.Random(seed)

    def lossy(now: float, data: bytes) -> bytes:
        return bytes(byte for byte in data if rng.random() >= rate)

    recorded = recorded_unit(to_unit=lossy, to_host=lossy)
    assert recorded.unharmed
    assert recorded.took_s < MOST_S
    assert (recorded.error is None) == (recorded.record.ended == Ended.COMPLETE)
    if rate < 0.01:
        assert recorded.error is None


def test_half_an_echo_is_recorded_to_the_end() -> None:
    def half(now: float, data: bytes) -> bytes:
        return data[: len(data) // 2] + b"\n" if b":" in data and data.endswith(b"\n") else data

    recorded = recorded_unit(to_host=half)
    assert recorded.error is None
    assert recorded.record.ended == Ended.COMPLETE
    assert recorded.record.manners == {"echoes": False, "adapter": False, "takes_turns": False}
    assert only_asked(recorded)


@pytest.mark.parametrize("at_s", [0.5, 1.2, 2.5, 4.0, 6.0, 9.0, 13.0, 17.0])
def test_a_cable_that_is_pulled_ends_the_recording_with_what_came(at_s: float) -> None:
    recorded = recorded_unit(prepare=lambda emulator, line, clock: clock.call_at(at_s, line.hang_up))
    assert isinstance(recorded.error, LinkLost)
    assert recorded.record.ended == Ended.LOST
    assert recorded.took_s < at_s + 3.0
    whole = recorded_unit().record.events
    begun = tuple(event for event in whole if event.time_s < at_s - 0.1)
    assert recorded.record.events[: len(begun)] == begun
    assert only_asked(recorded)


def test_a_cable_that_is_pulled_while_the_unit_is_identified_is_told_as_such() -> None:
    whole = recorded_unit().record.events
    at_s = next(event.time_s for event in whole if event.data == "identification") + 0.05
    recorded = recorded_unit(prepare=lambda emulator, line, clock: clock.call_at(at_s, line.hang_up))
    assert isinstance(recorded.error, LinkLost)
    assert recorded.record.ended == Ended.LOST


def test_a_line_that_looks_like_an_echo_of_a_motion_ends_no_recording() -> None:
    """The driver would stop the arm for it; a recording sends nothing for it and goes on."""
    stray = Fault("stray_line", When(command="AP", nth=3), text="COORDMV:1,2,3,4,5,6")
    recorded = recorded_unit(EmulatorOptions(faults=(stray,)))
    assert recorded.error is None
    assert any("COORDMV" in event.data for event in recorded.record.events)
    assert only_asked(recorded)


@pytest.mark.parametrize("at_s", [2.5, 6.0, 9.0, 13.0, 17.0])
def test_a_unit_that_falls_silent_ends_the_recording_with_what_came(at_s: float) -> None:
    recorded = recorded_unit(seconds=60.0, to_unit=lambda now, data: b"" if now > at_s else data)
    assert recorded.error is not None
    assert recorded.record.ended in (Ended.STOPPED, Ended.UNIDENTIFIED)
    if recorded.record.ended == Ended.STOPPED:
        assert isinstance(recorded.error, NoAnswer)
        assert "the unit stopped answering, in the step" in str(recorded.error)
    assert recorded.took_s < at_s + 60.0
    assert recorded.record.events[-1].time_s > at_s - 0.5
    assert only_asked(recorded)


def test_an_interrupt_keeps_what_came() -> None:
    def interrupt() -> None:
        raise KeyboardInterrupt

    clock = SteppedClock()
    with Emulator(load_unit("crs93"), clock) as emulator:
        recorder = Recorder(emulator.open_line(), FIRMWARE, 60.0, clock)
        clock.call_at(8.0, interrupt)
        with pytest.raises(KeyboardInterrupt):
            recorder.run()
    record = recorder.record()
    assert record.ended == Ended.INTERRUPTED
    assert 7.0 < record.events[-1].time_s <= 8.0


@pytest.mark.parametrize("error", [A465Error, OSError, ValueError])
def test_what_its_progress_raises_closes_the_port(error: Callable[[str], Exception]) -> None:
    clock = SteppedClock()
    line = MemoryLine(clock)
    closed: list[bool] = []
    line.close = lambda: closed.append(True)  # type: ignore[method-assign]

    def progress(step: str, record: object) -> None:
        raise error("disk full")

    with pytest.raises(Exception, match="disk full"):
        Recorder(line, FIRMWARE, 2.0, clock, progress).run()
    assert closed == [True]
