"""Lines and values: what is encoded is exact, what is parsed is never trusted."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from arm.controller.segments import Segment
from arm.errors import InputError
from driver.line.protocol import (
    COMMANDS,
    MAX_LINE,
    Answer,
    Failed,
    MalformedAnswer,
    Other,
    Position,
    Ready,
    Status,
    encode,
    encode_dwell,
    encode_query,
    encode_segment,
    parse_integer,
    parse_position,
    parse_reply,
    parse_status,
)

counts = st.integers(-99_999, 99_999)


def test_table_gives_axis_and_evidence_of_every_command() -> None:
    for name, command in COMMANDS.items():
        assert command.axis in ("", "x", "?"), name
        assert command.evidence, name
        assert set(command.evidence) <= set("DCUI")


def test_forms_that_the_public_clients_use() -> None:
    assert encode("REGMS", 7680, axis="A") == "REGMSA:7680"
    assert encode("STOP") == "STOP:"
    assert encode("SPDT", 0, 300, axis="B") == "SPDTB:0,300"
    assert encode("COORDGRP", *"ABCDEF") == "COORDGRP:A,B,C,D,E,F"
    assert encode("COORDMV", -181650, -349, -12200, 99200, 33300, -96500) == (
        "COORDMV:-181650,-349,-12200,99200,33300,-96500"
    )
    assert encode_query("AP", "G") == "APG?"
    assert encode_dwell(300, 6) == "COORDSPLINET:300,3," + ",".join(["0"] * 18)


@pytest.mark.parametrize(
    ("name", "values", "axis", "said"),
    [
        ("COORDISCONT", (5,), "", "not a command"),
        ("REGMS", (7680.5,), "A", "whole number"),
        ("REGMS", ("7680",), "A", "whole number"),
        ("REGMS", (True,), "A", "whole number"),
        ("REGMS", (2**31,), "A", "32-bit whole number"),
        ("REGMS", (1,), "", "needs an axis"),
        ("REGMS", (1,), "X", "needs an axis"),
        ("ECHO", (0,), "A", "takes no axis"),
        ("STAMP", (), "", "0 values, must be 1 to 1"),
        ("VER", (1,), "", "can only be asked"),
        ("COORDGRP", ("AB",), "", "whole number"),
    ],
)
def test_wrong_lines_are_refused(name: str, values: tuple[int, ...], axis: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        encode(name, *values, axis=axis)


def test_commands_cannot_be_asked() -> None:
    with pytest.raises(InputError, match="HH cannot be asked"):
        encode_query("HH", "A")


@given(st.integers(1, 5000), st.integers(2, 3).flatmap(lambda n: st.tuples(*[st.tuples(*[counts] * 6)] * n)))
def test_segment_line_holds_every_coefficient_axis_by_axis(
    ms: int, rows: tuple[tuple[int, ...], ...]
) -> None:
    segment = Segment(ms, rows)
    line = encode_segment(segment, segment.end().tolist())
    assert len(line) <= MAX_LINE
    duration, order, *values = (int(v) for v in line.removeprefix("COORDSPLINET:").split(","))
    assert (duration, order) == (ms, len(rows))
    back = tuple(tuple(values[power::order]) for power in range(order))
    assert back == rows


def test_straight_segment_goes_absolute() -> None:
    assert (
        encode_segment(Segment(60, ((1, 2, 3, 4, 5, 6),)), [10, 20, 30, 40, 50, 60])
        == "COORDMVT:60,10,20,30,40,50,60"
    )


def test_segments_that_cannot_be_sent_are_refused() -> None:
    with pytest.raises(InputError, match="0 ms and order 3"):
        encode_segment(Segment(0, ((1,) * 6,) * 3), [3] * 6)
    with pytest.raises(InputError, match="use shorter segments"):
        encode_segment(Segment(60_000, ((-(2**30),) * 6,) * 3), [0] * 6)


@given(st.binary(max_size=60))
def test_any_line_is_some_reply(data: bytes) -> None:
    reply = parse_reply(data.decode("latin-1"))
    assert isinstance(reply, Answer | Ready | Failed | Other)


def test_replies() -> None:
    assert parse_reply("ST=16") == Answer("ST", "16")
    assert parse_reply("VER=MARS8 v1.0 a=b") == Answer("VER", "MARS8 v1.0 a=b")
    assert parse_reply("R!") == Ready("")
    assert parse_reply("RG!") == Ready("G")
    assert parse_reply("FAIL!") == Failed()
    for other in ("R:", "ST?", "", "\xffST=16", "RX!", "FAIL", "r!"):
        assert isinstance(parse_reply(other), Other), other


@example("1_0")
@example("\xb2")
@example(" 7")
@given(
    st.one_of(
        st.binary(max_size=30).map(lambda data: data.decode("latin-1")),
        st.text("0123456789+-. _\xb2", max_size=16),
    )
)
def test_damaged_numbers_are_told_not_guessed(text: str) -> None:
    try:
        value = parse_integer(text)
    except MalformedAnswer:
        return
    assert text.lstrip("+-0") == str(abs(value)).lstrip("0")


def test_status_bits_are_masked() -> None:
    assert not Status(0x47 | 0x800).fault
    assert not Status(0x47).busy
    assert Status(0x10 | 0x1).busy
    assert Status(0x8).faults() == ("an axis is in error",)
    assert Status(0x30000).faults() == ("arm power is off", "motion stop is pressed")
    assert parse_status("131088") == Status(0x20010)
    for bad in ("-1", "262144", "1 6", "", "0x10", "1_6", "\u0661"):
        with pytest.raises(MalformedAnswer):
            parse_status(bad)


def test_position_needs_all_its_values() -> None:
    assert parse_position("65535,7,12,-1,2,3,4,5,6", 6) == Position(65535, 7, 12, (-1, 2, 3, 4, 5, 6))
    for bad in ("1,2,3,4,5,6,7,8", "1,2,3,4,5,6,7,8,", "1,2,3,4,5,6,7,8,8388608", "1,2,3,4,5,6,7,8,9,10", ""):
        with pytest.raises(MalformedAnswer):
            parse_position(bad, 6)
