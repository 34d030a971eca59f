"""Scripted faults of the emulated unit, at the wire: each does what it says, when it says, and is noted."""

from __future__ import annotations

import pytest

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.line.stepped_clock import SteppedClock
from emulated.faulty_unit import events, session, status
from wire.client import SteppedClient


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


def test_what_is_on_the_line_when_the_unit_is_switched_off_is_lost(unit: Unit) -> None:
    with session(unit, Fault("power_cycle", When(command="VER"))) as (emulator, client):
        client.send("ST?", "VER?", "GA:500")
        back = client.read_for(1.0)
        assert b"VER=" in back
        assert b"ST=" not in back  # half of it was sent
        assert "GA:500" not in [text for _, text in emulator.lines]


def test_a_unit_that_is_off_hears_nothing(unit: Unit) -> None:
    with session(unit, Fault("power_cycle", When(command="VER"), for_ms=4000)) as (_, client):
        client.send("VER?", "STAMP:3")
        assert client.read_for(3.9) == b""
        assert client.read_for(0.2) == b"\x00\xff\x80\xfe"
        client.send("STAMP:4")
        assert client.read_until(b"=4\r\n") == b"STAMP:4\nSTAMP=4\r\n"


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
