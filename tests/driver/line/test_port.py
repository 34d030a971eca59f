"""Ports that a link opens: exclusively, with a clear refusal, and never waiting without a deadline."""

from __future__ import annotations

import os
import pty
import socket
import threading
import tty
from pathlib import Path

import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from driver.emulator import Emulator
from driver.line.clock import Clock
from driver.line.link import Link, LinkLost
from driver.line.port import port_holder
from driver.line.wire_log import WireLog
from wire.whole_line import send_many


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("/dev/mars-that-is-not-there", "is not there"),
        ("/dev/null", "is not a serial line"),
        ("/tmp", "is a folder"),
        ("socket://127.0.0.1:9", "127.0.0.1:9: cannot be opened: Connection refused; is a unit or"),
        ("nonsense://x", "nonsense"),
        ("127.0.0.1:4650", "port 127.0.0.1:4650: must be socket://127.0.0.1:4650, or a device"),
        ("crs93.lab:9", "port crs93.lab:9: must be socket://crs93.lab:9, or a device"),
        ("/dev/serial/by-path/pci-0:14.0-usb-0:1:1", "is not there"),
        ("loop://", "must be a device, or socket://HOST:PORT"),
        (
            "'/dev/mars'",
            "port '/dev/mars': has quotes in its value, which are no part of a name; must be /dev/mars$",
        ),
        (
            "hall/COM3",
            "is not there: COM3 is a port's name on Windows; here a device is such as /dev/ttyUSB0",
        ),
        ("\\\\.\\COM12", "COM12 is a port's name on Windows"),
        ("/dev/mars ", "has spaces in its value, which are no part of a name; must be /dev/mars$"),
        ("SOCKET://127.0.0.1:4650", "must be socket://127.0.0.1:4650$"),
        ("socket//127.0.0.1:4650", "must be socket://127.0.0.1:4650$"),
        ("tcp://crs93.lab", "must be socket://crs93.lab:PORT$"),
        ("socket://127.0.0.1:99999", r"must be socket://HOST:PORT, such as .* \(PORT up to 65535\)$"),
        ("socket://127.0.0.1:0", r"\(PORT up to 65535\)$"),
        ("~/mars", "is not there: the shell did not replace its beginning"),
        ("$PORT", "is not there: the shell did not replace its beginning"),
        ("crs93", "is not there: it is a unit's name, and its port belongs here"),
        ("ttyUSB77", "is not there: the names of devices begin with /dev/: is /dev/ttyUSB77 meant?"),
        ("19200", "is not there: it is the line's speed, which is fixed"),
        ("4650", "the host is missing: socket://127.0.0.1:4650, or a device$"),
        ("/dev/video71", "is a camera's name, and the controller's port belongs here"),
        ("null", "is not there; is /dev/null meant, which is[?]$"),
        ("/dev/nulL2", "is not there; is /dev/null meant, which is[?]$"),
    ],
)
def test_a_port_that_cannot_be_opened_is_one_clear_line(url: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        Link(url, Clock())
    assert url in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_link_whose_target_is_gone_is_told_with_the_target(tmp_path: Path) -> None:
    (tmp_path / "mars").symlink_to(tmp_path / "gone")
    with pytest.raises(InputError) as refused:
        Link(str(tmp_path / "mars"), Clock())
    assert str(refused.value) == (
        f"port {tmp_path / 'mars'}: is a link to {tmp_path / 'gone'}, which is gone: the emulator or device behind it "
        "has ended; start it again"
    )


def test_two_programs_on_one_port(unit: Unit, tmp_path: Path) -> None:
    with Emulator(unit, Clock(1.0)) as emulator:
        url = emulator.open_pty()
        link = Link(url, emulator.clock)
        other_name = tmp_path / "mars"
        other_name.symlink_to(url)
        with pytest.raises(InputError, match="in use by another program"):
            Link(str(other_name), emulator.clock)
        holder = port_holder(str(other_name))
        assert holder is not None
        assert holder.pid == os.getpid()
        link.synchronise()  # the first is not disturbed
        link.close()
        assert port_holder(url) is None


def test_two_names_of_one_socket_are_one_port(unit: Unit) -> None:
    with Emulator(unit, Clock(1.0)) as emulator:
        url = emulator.open_tcp()
        number = url.rpartition(":")[2].strip("/")
        link = Link(url, emulator.clock)
        for name in (
            f"socket://localhost:{number}",
            f"socket://127.0.0.1:0{number}/",
            f"socket://LOCALHOST:{number}",
        ):
            holder = port_holder(name)
            assert holder is not None
            assert holder.pid == os.getpid()
        link.close()
        assert port_holder(f"socket://localhost:{number}") is None


def test_a_unit_that_takes_no_bytes_is_an_error_not_a_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("driver.line.clock.LEAST_WALL_S", 1.0)  # as it is
    master, slave = pty.openpty()
    tty.setraw(slave)
    link = Link(os.ttyname(slave), Clock(1000.0))
    with pytest.raises(LinkLost):
        send_many(link, "VER?" + " " * 90)
    link.close()
    os.close(slave)
    os.close(master)


def test_socket_urls_are_links_too(tmp_path: Path) -> None:
    clock = Clock(1.0)
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = server.accept()
        with connection:
            while data := connection.recv(100):
                for line in data.decode().splitlines():
                    if line.startswith("STAMP:"):
                        connection.sendall(line.replace(":", "=").encode() + b"\r\n")

    thread = threading.Thread(target=serve)
    thread.start()
    with WireLog(tmp_path / "log.jsonl", clock) as log:
        link = Link(f"socket://127.0.0.1:{server.getsockname()[1]}", clock, log)
        link.synchronise()
        link.close()
    thread.join()
    server.close()
    assert '"kind":"received","data":"STAMP=' in (tmp_path / "log.jsonl").read_text()
