"""Bytes that get lost, garbled, delayed or split: by themselves, and between a client and the emulated unit."""

from __future__ import annotations

import os

import pytest

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.emulator.faults.line import LineFaults
from driver.emulator.line.uart import Wire
from driver.line.stepped_clock import SteppedClock
from wire.client import SteppedClient


def acting(*faults: Fault) -> LineFaults:
    line = LineFaults()
    for fault in faults:
        line.begin(fault)
    return line


LINES = [b"STAMP=1\r\n", b"ST=16\r\n", b"R!\r\n"]


@pytest.mark.parametrize(
    ("fault", "expected"),
    [
        (Fault("lost_bytes", byte=3), [b"STMP=1\r\n", b"ST=16\r\n", b"R!\r\n"]),
        (Fault("lost_bytes", byte=10), [b"STAMP=1\r\n", b"T=16\r\n", b"R!\r\n"]),
        (Fault("lost_bytes", line=2), [b"STAMP=1\r\n", b"", b"R!\r\n"]),
        (Fault("lost_bytes"), [b"", b"", b""]),
    ],
)
def test_the_bytes_that_are_named_vanish(fault: Fault, expected: list[bytes]) -> None:
    for way in ("to_unit", "to_host"):
        line = acting(fault)
        if way == "to_unit":
            assert [line.to_unit(data) for data in LINES] == [(0.0, data) for data in expected]
        else:
            assert [b"".join(p for _, p in line.to_host(data)) for data in LINES] == expected


def test_garbling_flips_one_bit_and_keeps_the_length() -> None:
    line = acting(Fault("garbled_bytes", byte=12, seed=4))
    told = b"".join(piece for data in LINES for _, piece in line.to_host(data))
    differ = [k for k, (a, b) in enumerate(zip(told, b"".join(LINES), strict=True), start=1) if a != b]
    assert differ == [12]
    assert (told[11] ^ b"".join(LINES)[11]).bit_count() == 1


@pytest.mark.parametrize("kind", ["lost_bytes", "garbled_bytes"])
def test_about_as_many_are_hit_as_the_probability_says_and_the_seed_decides_which(kind: str) -> None:
    def hit(seed: int) -> list[bytes]:
        line = acting(Fault(kind, probability=0.1, seed=seed))  # type: ignore[arg-type]
        return [line.to_unit(b"x" * 100)[1] for _ in range(50)]

    first = hit(3)
    assert first == hit(3)
    assert first != hit(4)
    spared = sum(data.count(b"x") for data in first)
    assert 4350 <= spared <= 4650  # 4500 with a deviation of 21


def test_directions_are_apart() -> None:
    line = acting(Fault("lost_bytes", direction="to_unit"))
    assert line.to_unit(b"a\n") == (0.0, b"")
    assert line.to_host(b"a\n") == [(0.0, b"a\n")]
    line = acting(Fault("lost_bytes", direction="echo"))
    assert line.to_unit(b"a\n") == (0.0, b"a\n")
    assert line.to_host(b"a\n") == [(0.0, b"a\n")]
    assert line.to_host(b"a\n", echo=True) == []


def test_a_fault_that_is_over_does_nothing_and_an_equal_one_goes_on() -> None:
    one, other = Fault("lost_bytes"), Fault("lost_bytes")
    line = acting(one, other)
    line.end(one)
    assert line.to_unit(b"a\n") == (0.0, b"")
    line.end(other)
    assert line.to_unit(b"a\n") == (0.0, b"a\n")


def test_split_lines_come_in_two_pieces_and_lose_nothing() -> None:
    line = acting(Fault("split_bytes", delay_ms=7.0, direction="to_host"))
    for data in LINES:
        (first, a), (second, b) = line.to_host(data)
        assert (first, second) == (0.0, 7.0)
        assert a + b == data
        assert a
        assert b


def test_a_line_that_lost_its_end_runs_into_the_next() -> None:
    read, write = os.pipe()
    wire = Wire(read, EmulatorOptions(paced=False))
    assert wire.assemble(b"GA:1") == []
    assert wire.assemble(b"00\nGB:2\nG") == [b"GA:100\n", b"GB:2\n"]
    assert wire.assemble(b"\n") == [b"G\n"]
    for _ in range(1000):
        assert wire.assemble(b"y" * 60) == []
    assert len(wire.assemble(b"\n")[0]) == 1025
    os.close(read)
    os.close(write)


def test_delayed_lines_keep_their_order_and_each_is_late_by_as_much(unit: Unit) -> None:
    fault = Fault("delayed_bytes", When(command="ECHO"), direction="to_unit", delay_ms=500.0)
    with (
        Emulator(unit, SteppedClock(), options=EmulatorOptions(faults=(fault,))) as emulator,
        SteppedClient(emulator.open_line()) as client,
    ):
        client.send("ECHO:0", "STAMP:1", "STAMP:2", "STAMP:3")
        assert client.read_until(b"=3\r\n") == b"ECHO:0\nSTAMP=1\r\nSTAMP=2\r\nSTAMP=3\r\n"
        times = [ms for ms, _ in emulator.lines]
        assert 500 <= times[1] - times[0] <= 505
        assert times[3] - times[1] <= 9  # 16 bytes, 8 ms apart from each other as sent


def test_delayed_answers_are_late_on_the_unit_s_clock(unit: Unit) -> None:
    fault = Fault("delayed_bytes", When(command="STAMP"), direction="to_host", delay_ms=900.0, for_ms=20.0)
    with (
        Emulator(unit, SteppedClock(), options=EmulatorOptions(faults=(fault,))) as emulator,
        SteppedClient(emulator.open_line()) as client,
    ):
        client.send("ECHO:0", "VER?")
        client.read_until(b"45\r\n")
        clock = emulator.clock
        begin = clock.now()
        client.send("STAMP:1")
        assert client.read_until(b"=1\r\n") == b"STAMP=1\r\n"
        assert clock.now() - begin == pytest.approx(0.9 + 17 / 1920, abs=2e-3)
        begin = clock.now()
        client.send("STAMP:2")
        assert client.read_until(b"=2\r\n") == b"STAMP=2\r\n"
        assert clock.now() - begin == pytest.approx(17 / 1920, abs=2e-3)


def test_a_lost_line_end_joins_two_commands_at_the_wire(unit: Unit) -> None:
    fault = Fault("lost_bytes", When(command="ECHO"), direction="to_unit", byte=7)
    with (
        Emulator(unit, SteppedClock(), options=EmulatorOptions(faults=(fault,))) as emulator,
        SteppedClient(emulator.open_line()) as client,
    ):
        client.send("ECHO:0", "GA:100", "GB:200", "STAMP:1")
        assert client.read_until(b"=1\r\n") == b"ECHO:0\nSTAMP=1\r\n"
        assert [text for _, text in emulator.lines] == ["ECHO:0", "GA:100GB:200", "STAMP:1"]
        assert [text for _, text in emulator.ignored] == ["GA:100GB:200"]


def test_garbled_echoes_leave_the_answers_alone(unit: Unit) -> None:
    fault = Fault("garbled_bytes", direction="echo", seed=2)
    with (
        Emulator(unit, SteppedClock(), options=EmulatorOptions(faults=(fault,))) as emulator,
        SteppedClient(emulator.open_line()) as client,
    ):
        client.send("STAMP:1")
        told = client.read_until(b"=1\r\n")
        assert told.endswith(b"STAMP=1\r\n")
        assert not told.startswith(b"STAMP")
        assert [text for _, text in emulator.lines] == ["STAMP:1"]
