"""The nine requirements on an emulated unit (docs/sources.md, "Public clients"), one by one, where no other test of
the emulator states them."""

from __future__ import annotations

import itertools
import socket
import statistics
import termios
import time

import pytest
import serial

from arm.controller.unit import Unit, load_unit
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.commands import Interpreter
from driver.emulator.line.uart import Wire
from driver.emulator.unit.machine import Machine
from driver.line.clock import Clock
from emulated.connected_unit import connected
from timed.relative import cost_s, interpreted
from wire.client import Client

UNIT = load_unit("crs93")


def grouped(**options: object) -> Interpreter:
    unit = Interpreter(Machine(UNIT, None, EmulatorOptions(**options)))  # type: ignore[arg-type]
    unit.take("COORDGRP:A,B,C,D,E,F")
    return unit


def idle(unit: Interpreter) -> int:
    """Run until idle; how many ms that took."""
    begin = unit.machine.now_ms
    while unit.machine.busy:
        unit.machine.run(1)
        assert unit.machine.now_ms - begin < 120_000
    return unit.machine.now_ms - begin


def test_1_hardware_handshake_is_accepted_and_a_reopened_port_finds_the_same_positions(unit: Unit) -> None:
    with Emulator(unit, Clock(20.0)) as emulator:
        path = emulator.open_pty()
        for number in range(3):
            port = serial.Serial(path, 19200, rtscts=True, timeout=600.0)
            assert termios.tcgetattr(port.fd)[2] & termios.CRTSCTS
            port.write(b"ECHO:0\n" + (b"GA:700\nRA:\n" if not number else b"") + b"APA?\nAPB?\n")
            lines = [port.readline() for _ in range(4 if not number else 2)]
            if number:
                assert lines == [b"APA=700\r\n", b"APB=0\r\n"]
            port.close()


def test_2_every_line_is_one_write() -> None:
    unit_side, host_side = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    wire = Wire(unit_side.fileno(), EmulatorOptions(paced=True))
    lines = [b"APA=-181650\r\n", b"R!\r\n", b"COORDAP=" + b"123456," * 9 + b"\r\n"]
    for data in lines:
        wire.answer(data, 0.0)
    wire.flush(1e6)
    assert [host_side.recv(4096) for _ in lines] == lines
    unit_side.close()
    host_side.close()


def test_2_positions_are_answered_well_within_the_public_client_s_10_ms(unit: Unit) -> None:
    """In the unit's time, and with less of a processor's than a sum of 100 000 squares takes in Python."""
    with connected(unit, paced=False) as (emulator, client):
        costs = []
        for _ in range(50):
            begin, busy = emulator.clock.now(), time.thread_time()
            assert client.ask("APA?") == "APA=0"
            costs.append(time.thread_time() - busy)
            assert emulator.clock.now() - begin <= 1e-3
        assert statistics.median(costs) < cost_s(interpreted)


def test_2_the_status_is_a_plain_number_of_at_most_18_bits() -> None:
    machine = grouped(queue=51).machine
    unit = Interpreter(machine)
    words = set()
    for power, stop, error in itertools.product((True, False), repeat=3):
        machine.power, machine.motion_stop, machine.axis_errors = power, stop, {"A"} if error else set()
        (told,) = unit.take("ST?")
        assert told.removeprefix("ST=").isdecimal()
        words.add(int(told.removeprefix("ST=")))
    assert len(words) == 8
    assert max(words) < 2**18


def test_4_coorddiscont_is_honoured_and_its_misspelling_is_not() -> None:
    def duration(*settings: str) -> tuple[int, int]:
        unit = grouped(vertex_steps=0)
        for line in settings:
            assert unit.take(line) == []
        for k in range(20):
            unit.take(f"COORDRELMVT:100,500,{5 + k % 2},0,0,0,0")
        return idle(unit), len(unit.ignored)

    stopping, none_ignored = duration("COORDDISCONT:0")
    passing, _ = duration("COORDDISCONT:5")
    misspelt, ignored = duration("COORDISCONT:5")
    assert passing < 0.9 * stopping
    assert misspelt == stopping
    assert (none_ignored, ignored) == (0, 1)


@pytest.mark.parametrize("line", ["REGMS:A:7680", "REGACC:A:51", "REGMS::7680", "REGMSA:A:7680"])
def test_4_malformed_registers_are_ignored_without_an_answer(line: str) -> None:
    unit = grouped()
    before = dict(unit.machine.registers)
    assert unit.take(line) == []
    assert unit.machine.registers == before
    assert [text for _, text in unit.ignored] == [line]
    assert grouped(unknown="fail").take(line) == ["FAIL!"]


def test_5_coordap_is_three_numbers_and_the_axes_in_the_order_of_the_group(unit: Unit) -> None:
    with connected(unit) as (_, client):
        for group in ("A,B,C,D,E,F", "F,A"):
            client.send(f"COORDGRP:{group}")
            values = client.ask("COORDAP?").removeprefix("COORDAP=").split(",")
            assert len([int(v) for v in values]) == 3 + len(group.split(","))


def test_5_axes_are_homed_with_the_group_formed_and_coordap_tells_it(unit: Unit) -> None:
    with connected(unit) as (emulator, client):
        client.send("COORDGRP:A,B,C,D,E,F", "COORDMV:0,700,0,0,0,0", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert client.ask("COORDAP?").split(",")[3:] == ["0", "700", "0", "0", "0", "0"]
        assert emulator.counts()[1] not in (0, 700)
        client.send("HHB:", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert client.ask("COORDAP?").split(",")[3:] == ["0"] * 6
        assert emulator.counts()[1] == 0


def test_6_purge_and_stop_leave_it_idle_at_once_or_when_it_has_braked(unit: Unit) -> None:
    with connected(unit) as (_, client):
        client.send("PURGE:", "STOP:")
        assert client.ask("ST?") == "ST=0"
    unit_ = grouped()
    unit_.take("COORDMV:90000,0,0,0,0,0")
    unit_.machine.run(400)
    unit_.take("PURGE:")
    unit_.take("STOP:")
    assert unit_.take("ST?") == ["ST=16"]
    assert 0 < idle(unit_) <= 410  # 404 ms to and from the default speed
    assert unit_.take("ST?") == ["ST=0"]


@pytest.mark.parametrize("scale", [1.0, 5.0, 20.0])
def test_7_the_time_scale_is_that_of_motion_and_line(unit: Unit, scale: float) -> None:
    """On a port of the host: not sooner than that; and the unit lives through as much time as the wall says."""
    with Emulator(unit, Clock(scale)) as emulator, Client(emulator.open_pty()) as client:
        lived, begin = emulator.clock.now(), time.monotonic()
        client.send("GA:6000", "RA:")
        client.read_until(b"!\r\n")
        took = time.monotonic() - begin
        assert took * scale >= 0.345  # 6000 counts at 30 a ms, 150 ms of acceleration, 9 bytes
        assert emulator.clock.now() - lived >= scale * took
        client.send("STAMP:1")
        client.read_until(b"=1\r\n")
        assert emulator.lines[-1][0] >= 1e3 * (lived + scale * took) - 1


def test_7_motion_and_line_take_their_time(unit: Unit) -> None:
    with connected(unit) as (emulator, client):
        begin = emulator.clock.now()
        client.send("GA:60000", "RA:")
        client.read_until(b"!\r\n")
        # 60000 counts at 30 a ms, 150 ms of acceleration; 13 bytes to it, 5 back; looked at every 4 ms
        assert emulator.clock.now() - begin == pytest.approx(2.0 + 0.1506 + 18 / 1920.0, abs=6e-3)


def test_7_a_static_error_is_there_at_rest_only_and_drawn_anew_by_the_seed() -> None:
    def rests(seed: int) -> list[str]:
        unit = grouped(static_error=9, seed=seed)
        found = []
        for target in (500, 1000, 1500):
            unit.take(f"COORDMV:{target},0,0,0,0,0")
            unit.machine.run(1)
            assert unit.machine.actual() == unit.machine.path.at
            idle(unit)
            off = [a - r for a, r in zip(unit.machine.actual(), unit.machine.path.at, strict=True)]
            assert all(abs(o) <= 9 for o in off)
            found.append(str(off))
        return found

    assert len(set(rests(1))) == 3
    assert rests(1) == rests(1) != rests(2)


def test_7_a_full_queue_may_refuse_or_drop() -> None:
    for overflow, answer in (("fail", ["FAIL!"]), ("drop", [])):
        unit = grouped(queue=2, overflow=overflow)
        told = [unit.take("COORDRELMVT:50,100,0,0,0,0,0") for _ in range(3)]
        assert told == [[], [], answer]
        idle(unit)
        assert unit.machine.path.at[0] == 200
        assert len(unit.machine.violations) == 1


class Block:
    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        return max(to_adc, 471)


def test_8_jaws_stall_on_an_object_although_their_axis_says_ready_and_release_holds_them() -> None:
    unit = Interpreter(Machine(UNIT, Block(), EmulatorOptions()))
    unit.take("GG:-800")
    assert unit.take("RG:") == []
    assert unit.take("ST?") == ["ST=16"]
    idle(unit)
    assert unit.ready() == ["RG!"]
    assert unit.take("APG?") == ["APG=471"]
    unit.take("GG:840")
    unit.machine.run(50)
    (part_way,) = unit.take("APG?")
    unit.take("RELEASEG:")
    assert not unit.machine.busy
    unit.machine.run(500)
    assert unit.take("APG?") == [part_way]
    assert 471 < int(part_way.removeprefix("APG=")) < 840


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["COORDMV:0,0,0,0,0,900000"], "axis F at"),
        (["COORDMV:5000,0,0,0,0,0", "REGMSA:100"], "REGMSA changed while it moves"),
        (["COORDMV:5000,0,0,0,0,0", "COORDGRP:A,B"], "group changed while it moves"),
        (["COORDMV:5000,0,0,0,0,0", "GA:1"], "axis A commanded while the group moves"),
        (["COORDMV:5000,0,0,0,0,0", "RELEASE:"], "released while moving"),
        (["GA:9000", *["R:"] * 101], "more than 100 waits"),
    ],
)
def test_9_what_a_careful_driver_never_does_is_done_or_ignored_but_noted(lines: list[str], told: str) -> None:
    unit = grouped()
    for line in lines:
        assert unit.take(line) == []
        unit.machine.run(2)
    idle(unit)
    unit.machine.run(1)
    assert any(told in violation.what for violation in unit.machine.violations)
    assert unit.machine.violated == len(unit.machine.violations)
