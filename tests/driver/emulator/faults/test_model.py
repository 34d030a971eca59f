"""Scripted faults of the emulated unit, at the wire: each does what it says, when it says, and is noted."""

from __future__ import annotations

import itertools
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.emulator.faults.model import KINDS
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from wire.client import Client, SteppedClient, wait_for

GROUP = ("ECHO:0", "COORDGRP:A,B,C,D,E,F", "COORDDISCONT:5")


class Block:
    """Something between the jaws."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        return max(to_adc, 471)


@contextmanager
def on_ports(unit: Unit, *faults: Fault) -> Iterator[Emulator]:
    """In wall time, for ports of the host."""
    with Emulator(unit, Clock(20.0), Block(), EmulatorOptions(faults=faults)) as emulator:
        yield emulator


@contextmanager
def session(unit: Unit, *faults: Fault, **options: object) -> Iterator[tuple[Emulator, SteppedClient]]:
    """An emulator with these faults, and a client that has switched the echo off and formed the group."""
    made = EmulatorOptions(faults=faults, **options)  # type: ignore[arg-type]
    with (
        Emulator(unit, SteppedClock(), Block(), made) as emulator,
        SteppedClient(emulator.open_line()) as client,
    ):
        client.send(*GROUP, "STAMP:1")
        assert client.read_until(b"STAMP=1\r\n").endswith(b"STAMP=1\r\n")
        yield emulator, client


def events(emulator: Emulator) -> list[tuple[str, bool]]:
    return [(e.kind, e.over) for e in emulator.faults]


def status(client: SteppedClient) -> int:
    return int(client.ask("ST?").removeprefix("ST="))


def position(client: SteppedClient) -> list[int]:
    return [int(v) for v in client.ask("COORDAP?").removeprefix("COORDAP=").split(",")]


@pytest.mark.parametrize(
    ("fault", "bit"),
    [
        (Fault("power_off", When(command="COORDMV", after_ms=300)), 0x10000),
        (Fault("motion_stop", When(command="COORDMV", after_ms=300)), 0x20000),
        (Fault("axis_error", When(command="COORDMV", after_ms=300), axis="C"), 0x8),
    ],
)
def test_the_cabinet_stops_the_arm_at_the_given_ms(unit: Unit, fault: Fault, bit: int) -> None:
    with session(unit, fault) as (emulator, client):
        client.send("COORDMV:90000,0,0,0,0,0", "R:")
        assert client.read_until(b"!\r\n") == b"FAIL!\r\n"
        assert status(client) == bit
        obeyed = next(ms for ms, text in emulator.lines if text.startswith("COORDMV"))
        assert [e.time_ms for e in emulator.faults] == [obeyed + 300]
        record = emulator.record()
        assert record.time_ms[-1] == obeyed + 300  # not one ms more
        assert tuple(record.counts[-1]) == emulator.counts()


def test_power_comes_back_after_a_time_and_the_old_methods_stay(unit: Unit) -> None:
    with session(unit, Fault("power_off", When(command="GA"), for_ms=500)) as (emulator, client):
        assert client.ask("ST?") == "ST=0"
        client.send("GA:1000")
        assert status(client) == 0x10000
        client.wait_for(lambda: status(client) == 0)
        emulator.set_motion_stop(True)
        assert status(client) == 0x20000
        emulator.set_motion_stop(False)
        emulator.fail_axis("B")
        assert status(client) == 0x8
        client.send("PURGE:")
        assert status(client) == 0
        assert events(emulator) == [
            ("power_off", False), ("power_off", True), ("motion_stop", False), ("motion_stop", True),
            ("axis_error", False),
        ]  # fmt: skip
        times = [e.time_ms for e in emulator.faults]
        assert times[1] - times[0] == 500
        assert "during a fault" in emulator.violations[0].what


def test_time_counts_from_the_first_byte_and_not_from_power_up(unit: Unit) -> None:
    fault = Fault("axis_error", When(after_ms=1000), axis="A")
    with Emulator(unit, SteppedClock(), options=EmulatorOptions(faults=(fault,))) as emulator:
        emulator.clock.sleep(3.0)
        with SteppedClient(emulator.open_line()) as client:
            assert emulator.faults == ()
            client.send("ECHO:0")
            client.wait_for(lambda: emulator.faults)
            assert emulator.faults[0].time_ms == 3000 + 1000


def test_the_third_segment_is_the_first_to_meet_a_fault_at_the_third_segment(unit: Unit) -> None:
    faults = Fault("queue_overflow", When(command="COORDRELMVT", nth=3), count=1)
    with session(unit, faults) as (_, client):
        client.send(*[f"COORDRELMVT:50,{10**k},0,0,0,0,0" for k in range(4)], "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert position(client)[3] == 1011


def test_a_fault_at_an_executed_segment_comes_when_it_begins(unit: Unit) -> None:
    with session(unit, Fault("motion_stop", When(segment=3))) as (_, client):
        client.send("COORDSPLINET:300,1,0,0,0,0,0,0", *["COORDRELMVT:100,500,0,0,0,0,0"] * 4, "R:")
        assert client.read_until(b"!\r\n") == b"FAIL!\r\n"
        assert 500 <= position(client)[3] <= 510


def test_a_fail_takes_the_place_of_ready(unit: Unit) -> None:
    with session(unit, Fault("fail_reply", When(command="R", nth=2))) as (emulator, client):
        assert client.ask("R:") == "R!"
        assert client.ask("RA:") == "FAIL!"
        assert status(client) == 0
        assert client.ask("R:") == "R!"
        client.send("GA:20000", "R:", "STAMP:5")
        assert client.read_until(b"=5\r\n") == b"STAMP=5\r\n"
        emulator.inject(Fault("fail_reply"))  # one that is waited for fails at once
        assert client.read_until(b"!\r\n") == b"FAIL!\r\n"
        assert status(client) == 0x10


def test_ready_may_come_before_the_motion_has_ended(unit: Unit) -> None:
    with session(unit, Fault("early_ready", When(command="R"))) as (_, client):
        client.send("COORDMV:9000,0,0,0,0,0", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert status(client) == 0x10
        assert client.ask("R:") == "R!"
        assert position(client)[3] == 9000


def test_ready_may_come_before_the_arm_has_settled(unit: Unit) -> None:
    with session(unit, Fault("lag", lag_ms=400)) as (_, client):
        client.send("COORDMV:9000,0,0,0,0,0", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert status(client) == 0
        assert position(client)[3] < 8990
        client.wait_for(lambda: position(client)[3] == 9000)


def test_a_stuck_axis_stays_while_the_generator_goes_on(unit: Unit) -> None:
    fault = Fault("stuck_axis", When(command="COORDMV", after_ms=400), axis="B", for_ms=8000)
    with session(unit, fault) as (emulator, client):
        client.send("COORDMV:9000,9000,0,0,0,0", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        _, _, _, a, b, *_ = position(client)
        assert a == 9000
        assert 0 < b < 3000
        assert emulator.machine.reference[1] == 9000
        record = emulator.record().counts[:, 1]
        assert record[-1] - record[0] <= b  # the truth is what the encoders say
        client.wait_for(lambda: position(client)[4] == 9000)  # and when it is free again, it follows


def test_a_stuck_axis_never_finds_its_mark(unit: Unit) -> None:
    with session(unit, Fault("stuck_axis", axis="A")) as (emulator, client):
        client.send("HHA:", "HHB:", "RB:")
        assert client.read_until(b"!\r\n") == b"RB!\r\n"
        client.wait_for(
            lambda: emulator.now_ms() > 25_000
        )  # at 15 counts/ms it would have been there after 16.6 s
        assert status(client) == 0x10
        assert position(client)[3:5] == [0, 0]
        client.send("STOP:", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert emulator.machine.homed[:2] == [False, True]


def test_an_axis_creeps_away_and_homing_finds_it_again(unit: Unit) -> None:
    fault = Fault("drift", axis="E", counts_per_s=-200.0, most_counts=700)
    with session(unit, fault) as (emulator, client):
        start, *_, first, _ = position(client)
        later, *_, second, _ = position(client)
        assert second <= first <= 0
        assert abs(second - first + 0.2 * (later - start)) <= 2
        client.wait_for(lambda: position(client)[7] == -700)
        client.send("HHE:", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert position(client)[7] == emulator.counts()[4] == 0
        steps = emulator.record().counts[:, 4]
        assert max(abs(b - a) for a, b in itertools.pairwise(steps)) < 100  # it went there


def test_jaws_miss_what_is_there_once(unit: Unit) -> None:
    with session(unit, Fault("missed_grasp", When(command="GG", nth=2))) as (_, client):
        ends = []
        for target in (840, 103, 840, 103):
            client.send(f"GG:{target}", "RG:")
            assert client.read_until(b"!\r\n") == b"RG!\r\n"
            ends.append(client.ask("APG?"))
        assert ends == ["APG=840", "APG=103", "APG=840", "APG=471"]


def test_a_smaller_queue_overflows_and_says_so_in_the_status(unit: Unit) -> None:
    fault = Fault("queue_overflow", When(command="COORDRELMVT"), queue=3)
    with session(unit, fault, overflow="fail") as (emulator, client):
        client.send(*["COORDRELMVT:100,10,0,0,0,0,0"] * 5, "STAMP:2")
        assert client.read_until(b"=2\r\n") == b"FAIL!\r\nFAIL!\r\nSTAMP=2\r\n"
        assert status(client) & 0x80
        assert client.ask("R:") == "R!"
        assert position(client)[3] == 30
        assert len([v for v in emulator.violations if "beyond the queue's 3" in v.what]) == 2


def test_a_power_cycle_forgets_everything_but_where_the_arm_is(unit: Unit) -> None:
    with session(unit, Fault("power_cycle", When(command="STAMP", nth=2))) as (emulator, client):
        client.send("HHA:", "HHB:", "REGMSA:5000", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        client.send("COORDMV:9000,900,0,0,0,0", "R:")
        client.wait_for(lambda: emulator.counts()[0] > 500)
        client.send("STAMP:9")
        back = client.read_until(b"STAMP=9\r\n")
        assert back == b"\x00\xff\x80\xfeSTAMP:9\nSTAMP=9\r\n"  # noise, echo, and no R!
        here = emulator.counts()
        assert here[0] > 500
        client.send("ECHO:0", "COORDAP?", "ST?")
        assert client.read_until(b"ST=0\r\n") == b"ECHO:0\nST=0\r\n"  # no group: COORDAP is not understood
        assert client.ask("APA?") == "APA=0"
        assert emulator.counts() == here
        assert emulator.machine.registers["REGMSA"] == unit.speed_registers[0]
        assert emulator.machine.registers["COORDDISCONT"] == 1
        client.send("HHA:", "RA:")
        assert client.read_until(b"!\r\n") == b"RA!\r\n"
        assert emulator.counts()[0] == 0
        assert emulator.counts()[1:] == here[1:]


def test_a_unit_that_is_off_hears_nothing(unit: Unit) -> None:
    with session(unit, Fault("power_cycle", When(command="VER"), for_ms=4000)) as (_, client):
        client.send("VER?", "STAMP:3")
        assert client.read_for(3.9) == b""
        assert client.read_for(0.2) == b"\x00\xff\x80\xfe"
        client.send("STAMP:4")
        assert client.read_until(b"=4\r\n") == b"STAMP:4\nSTAMP=4\r\n"


def test_a_pseudo_terminal_goes_and_comes_back_behind_its_link(unit: Unit, tmp_path: Path) -> None:
    link = tmp_path / "mars"
    with on_ports(unit, Fault("port_gone", When(command="GA"), back_after_s=20.0)) as emulator:
        emulator.open_pty(link)
        with Client(str(link)) as client:
            client.send("ECHO:0", "GA:700")
            with pytest.raises(OSError, match=r"closed|Input/output"):
                client.read_until(b"nothing", 5.0)
            wait_for(lambda: not os.path.lexists(link))
        wait_for(link.exists)
        assert emulator.paths() == (os.readlink(link),)
        with Client(str(link)) as again:
            assert again.ask("APA?") == "APA=700"  # the echo is off, positions are kept
        assert events(emulator) == [("port_gone", False), ("port_gone", True)]
    assert not os.path.lexists(link)


@pytest.mark.slow
def test_a_tcp_connection_goes_and_a_new_one_is_taken(unit: Unit) -> None:
    with on_ports(unit) as emulator:
        url = emulator.open_tcp()
        with Client(url) as client:
            client.send("ECHO:0", "STAMP:1")
            client.read_until(b"=1\r\n")
            emulator.inject(Fault("port_gone", back_after_s=200.0))
            with pytest.raises(OSError, match=r"closed|reset"):
                client.read_until(b"nothing", 5.0)
        with pytest.raises(ConnectionRefusedError):
            Client(url)
        wait_for(lambda: len(emulator.faults) == 2, 60.0)
        wait_for(lambda: emulator._ports.listeners)
        with Client(url) as again:
            assert again.ask("APA?") == "APA=0"


def test_a_port_that_never_comes_back(unit: Unit) -> None:
    with on_ports(unit, Fault("port_gone", When(after_ms=500))) as emulator:
        url = emulator.open_tcp()
        with Client(url) as client:
            client.send("ECHO:0", "GA:100000")
            wait_for(lambda: emulator.faults)
        wait_for(lambda: emulator.now_ms() > 3000)  # what was told goes on
        with pytest.raises(ConnectionRefusedError):
            Client(url)


def test_unasked_lines_and_noise(unit: Unit) -> None:
    faults = (
        Fault("stray_line", When(command="VER"), text="R!"),
        Fault("noise", When(command="ST"), count=9),
    )
    with session(unit, *faults) as (_, client):
        client.send("VER?")
        assert client.read_until(b"45\r\n") == b"R!\r\n" + f"VER={EmulatorOptions().version}\r\n".encode()
        client.send("ST?")
        assert len(client.read_until(b"ST=0\r\n")) == 9 + 6


def test_the_same_seed_goes_wrong_the_same_way(unit: Unit) -> None:
    def answers(seed: int) -> bytes:
        fault = Fault("garbled_bytes", When(command="STAMP", nth=2), probability=0.05, seed=seed)
        with session(unit, fault, paced=False) as (_, client):
            client.send(*[f"STAMP:{n}" for n in range(100, 200)])
            return client.read_for(6.0)

    first = answers(1)
    assert first == answers(1)
    assert first != answers(2)
    assert (
        30 <= first.count(b"\nSTAMP=1") <= 90
    )  # of 100: a line of 10 bytes is spared with 0.95^10 = 60 %, twice


def test_every_kind_can_be_injected_while_the_arm_moves(unit: Unit) -> None:
    fields = {
        "axis_error": {"axis": "B"}, "stuck_axis": {"axis": "B"}, "drift": {"axis": "B", "counts_per_s": 5.0},
        "lag": {"lag_ms": 20.0}, "delayed_bytes": {"delay_ms": 5.0}, "stray_line": {"text": "x"},
    }  # fmt: skip
    for kind in KINDS:
        with session(unit) as (emulator, client):
            client.send("COORDMV:90000,0,0,0,0,0", "R:", "STAMP:2")
            client.read_until(b"=2\r\n")
            emulator.inject(Fault(kind, **fields.get(kind, {})))  # type: ignore[arg-type]
            assert events(emulator) == [(kind, False)]
            client.line.clock.sleep(0.5)
            assert emulator.failure is None


@pytest.mark.slow
def test_a_link_that_somebody_else_has_made_meanwhile_ends_the_emulator_and_says_why(
    unit: Unit, tmp_path: Path
) -> None:
    link = tmp_path / "mars"
    with on_ports(unit) as emulator:
        emulator.open_pty(link)
        emulator.inject(Fault("port_gone", back_after_s=100.0))
        wait_for(lambda: not os.path.lexists(link))
        link.write_text("mine")
        wait_for(lambda: emulator.failure is not None)
        assert "cannot link to" in str(emulator.failure)
    assert link.read_text() == "mine"


def test_a_fault_may_be_ordered_while_the_jaws_act(unit: Unit) -> None:
    class Trap:
        def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
            emulator.inject(Fault("motion_stop"))
            return to_adc

    with (
        Emulator(unit, SteppedClock(), Trap()) as emulator,
        SteppedClient(emulator.open_line()) as client,
    ):
        client.send("ECHO:0", "GG:103", "RG:", "STAMP:1")
        assert client.read_until(b"=1\r\n") == b"ECHO:0\nFAIL!\r\nSTAMP=1\r\n"
        assert client.ask("APG?") == "APG=840"
