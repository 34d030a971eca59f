"""The emulated unit at the byte level: echo, line ends, partial lines, baud rate, clients that come and go."""

from __future__ import annotations

import os
import socket
import time

import pytest

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.line.uart import Wire
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from emulated.terminal import Terminal
from timed.relative import cost_s, interpreted
from wire.client import SteppedClient


def test_echo_is_on_at_power_up_and_can_be_switched_off(terminal: Terminal) -> None:
    terminal.send(b"STAMP:7\n")
    assert terminal.receive(b"=7\r\n") == b"STAMP:7\nSTAMP=7\r\n"
    terminal.send(b"\nECHO:0\nSTAMP:8\n")
    assert terminal.receive(b"=8\r\n") == b"\nECHO:0\nSTAMP=8\r\n"
    terminal.send(b"ST?\n")
    assert terminal.receive(b"\n") == b"ST=0\r\n"


def test_partial_lines_and_carriage_returns(terminal: Terminal) -> None:
    terminal.send(b"ECHO:0\r\nSTA")
    assert terminal.receive(b"ECHO:0\r\n") == b"ECHO:0\r\n"
    assert terminal.quiet()
    terminal.send(b"MP:")
    assert terminal.quiet()
    terminal.send(b"12\r\n\r\n\nSTAMP:13\n")
    assert terminal.receive(b"13\r\n") == b"STAMP=12\r\nSTAMP=13\r\n"


def test_answers_come_in_the_order_of_lines(terminal: Terminal) -> None:
    terminal.send(b"ECHO:0\nAPA?\nSTAMP:1\nR:\nSTAMP:2\n")
    assert terminal.receive(b"=2\r\n").split(b"\n", 1)[1] == b"APA=0\r\nSTAMP=1\r\nR!\r\nSTAMP=2\r\n"


def test_a_thousand_bytes_take_their_time(served: Emulator, terminal: Terminal) -> None:
    terminal.send(b"ECHO:0\n")
    terminal.receive(b"ECHO:0\n")
    begin = served.clock.now()
    terminal.send(b"STAMP:00001\n" * 100 + b"VER?\n")
    terminal.receive(b"11:06:45\r\n")
    seconds = served.clock.now() - begin
    assert seconds >= 1205 / 1920.0


def test_unpaced_bytes_take_none(unit: Unit) -> None:
    clock = SteppedClock()
    with Emulator(unit, clock, options=EmulatorOptions(paced=False)) as emulator:
        client = SteppedClient(emulator.open_line())
        client.write(b"ECHO:0\n" + b"STAMP:1\n" * 300 + b"STAMP:2\n")
        assert client.read_until(b"=2\r\n").count(b"STAMP=1\r\n") == 300
        assert clock.now() == 0.0  # 1.25 s at 19200 baud


def test_power_up_noise(unit: Unit) -> None:
    with Emulator(unit, Clock(20.0), options=EmulatorOptions(noise=b"\xff\x00\x80")) as emulator:
        terminal = Terminal(emulator.open_pty())
        terminal.send(b"STAMP:1\n")
        assert terminal.receive(b"=1\r\n") == b"\xff\x00\x80STAMP:1\nSTAMP=1\r\n"
        terminal.close()


def test_what_a_client_sent_before_it_left_is_obeyed(unit: Unit) -> None:
    clock = Clock(1.0)
    with Emulator(unit, clock) as emulator:
        port = int(emulator.open_tcp().rsplit(":", 1)[1])
        with socket.create_connection(("127.0.0.1", port), timeout=600.0) as client:
            client.sendall(b"ECHO:0\nSTAMP:0000000001\nGA:30\n")  # 15 ms on the line
        deadline = time.monotonic() + 600.0
        while len(emulator.lines) < 3 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert [text for _, text in emulator.lines][-1] == "GA:30"


@pytest.mark.parametrize("noise", [b"\x00" * 3000, b"A" * 5000, bytes(range(256)) * 8])
def test_rubbish_is_survived(terminal: Terminal, noise: bytes) -> None:
    terminal.send(noise + b"\nECHO:0\nSTAMP:77\n")
    assert terminal.receive(b"STAMP=77\r\n").endswith(b"STAMP=77\r\n")


def test_a_line_without_end_is_not_kept_for_ever() -> None:
    read, write = os.pipe()
    wire = Wire(read, EmulatorOptions(paced=False))
    for _ in range(100):
        os.write(write, b"A" * 64)
        assert wire.receive(0.0)
    os.write(write, b"\n")
    wire.receive(0.0)
    assert len(wire.take_line()) <= 1025
    os.close(write)
    assert not wire.receive(0.0)
    os.close(read)


def test_a_fault_stops_the_arm_where_it_is(served: Emulator, terminal: Terminal) -> None:
    terminal.send(b"ECHO:0\nGA:3000000\nRA:\n")  # 5 s on the wall
    stood, deadline = served.counts()[0], time.monotonic() + 600.0
    while served.counts()[0] < stood + 2000 and time.monotonic() < deadline:
        time.sleep(0.01)
    served.set_power(False)
    assert terminal.receive(b"FAIL!\r\n").endswith(b"FAIL!\r\n")
    here = served.counts()
    served.set_power(True)
    terminal.send(b"RA:\n")
    assert terminal.receive(b"RA!\r\n") == b"RA!\r\n"
    assert served.counts() == here


def test_an_idle_unit_costs_nothing(served: Emulator, terminal: Terminal) -> None:
    terminal.send(b"ECHO:0\nSTAMP:1\n")
    terminal.receive(b"=1\r\n")
    assert cost_s(lambda: time.sleep(0.5)) < cost_s(interpreted)
