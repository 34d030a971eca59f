"""Ports of the emulated unit: clients come and go, links and listeners are lost and come back."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.line.clock import Clock
from emulated.faulty_unit import Block, events
from emulated.terminal import Terminal
from wire.client import Client, wait_for


@contextmanager
def on_ports(unit: Unit, *faults: Fault) -> Iterator[Emulator]:
    """In wall time, for ports of the host."""
    with Emulator(unit, Clock(20.0), Block(), EmulatorOptions(faults=faults)) as emulator:
        yield emulator


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


def test_clients_come_and_go(served: Emulator, tmp_path: Path) -> None:
    link = tmp_path / "mars"
    path = served.open_pty(link)
    first = Terminal(str(link))
    first.send(b"ECHO:0\nGA:500\nRA:\n")
    assert first.receive(b"RA!\r\n").endswith(b"RA!\r\n")
    first.close()
    time.sleep(0.05)
    second = Terminal(path)
    second.send(b"APA?\n")
    assert second.receive(b"\n") == b"APA=500\r\n"
    second.close()
    served.close()
    assert not link.exists()


def test_a_link_that_exists_is_left_alone(served: Emulator, tmp_path: Path) -> None:
    link = tmp_path / "mars"
    link.write_text("mine")
    with pytest.raises(InputError, match="cannot link to"):
        served.open_pty(link)
    assert link.read_text() == "mine"


def test_tcp_clients_come_and_go(served: Emulator) -> None:
    port = int(served.open_tcp().rsplit(":", 1)[1])
    for stamp in (b"1", b"2"):
        with socket.create_connection(("127.0.0.1", port), timeout=600.0) as client:
            client.sendall(b"ECHO:0\nSTAMP:" + stamp + b"\n")
            data = b""
            while not data.endswith(b"=" + stamp + b"\r\n"):
                data += client.recv(4096)
    assert served.counts() == served.machine.true_counts()


def test_closing_twice_and_with_a_client_is_fine(served: Emulator, terminal: Terminal) -> None:
    terminal.send(b"GA:100000\n")
    time.sleep(0.02)
    served.close()
    served.close()


def test_a_second_client_is_turned_away_until_the_first_one_leaves(served: Emulator) -> None:
    port = int(served.open_tcp().rsplit(":", 1)[1])
    with socket.create_connection(("127.0.0.1", port), timeout=600.0) as first:
        first.sendall(b"ECHO:0\nSTAMP:1\n")
        assert _until(first, b"STAMP=1\r\n")
        with socket.create_connection(("127.0.0.1", port), timeout=600.0) as second:
            assert second.recv(100) == b""
        first.sendall(b"STAMP:2\n")
        assert _until(first, b"STAMP=2\r\n")
    deadline = time.monotonic() + 600.0
    while time.monotonic() < deadline:
        with socket.create_connection(("127.0.0.1", port), timeout=600.0) as third:
            third.sendall(b"STAMP:3\n")
            if _until(third, b"STAMP=3\r\n"):
                return
    raise AssertionError("nobody was let in again")


def _until(client: socket.socket, ends: bytes) -> bool:
    """Whether such bytes come before the other side closes."""
    data = b""
    while not data.endswith(ends):
        try:
            part = client.recv(4096)
        except ConnectionError:
            return False
        if not part:
            return False
        data += part
    return True
