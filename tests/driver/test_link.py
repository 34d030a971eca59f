"""The link at the wire: gates, order, deadlines, pacing, and a stop that is never behind."""

from __future__ import annotations

import os
import pty
import select
import socket
import threading
import time
import tty
from pathlib import Path
from typing import Any

import pytest

from arm.errors import A465Error, InputError
from driver.clock import Clock
from driver.link import Link, LinkLost, NoAnswer
from driver.protocol import BYTES_PER_SECOND, Failed, Ready
from driver.wirelog import WireLog


@pytest.fixture
def link(fake: Any, clock: Clock) -> Any:
    link = Link(fake.url, clock)
    yield link
    link.close()


def send_many(link: Link, line: str) -> None:
    for _ in range(2000):
        link.send(line)


def read_all(link: Link) -> None:
    while link.receive(link.clock.now() + 1.0) is not None:
        pass


@pytest.mark.parametrize(
    "line", ["ST?", "STOP:", "PURGE:", "R:", "COORDMV:1,2,3,4,5,6", "garbage", "RELEASE:"]
)
def test_an_unknown_unit_gets_no_command(link: Link, fake: Any, line: str) -> None:
    with pytest.raises(A465Error, match="has not identified itself"):
        link.send(line)
    link.send_stop()
    link.synchronise()
    assert fake.lines[0].startswith("STAMP:")


def test_echo_noise_and_stale_stamps_are_passed_over(link: Link, fake: Any) -> None:
    def noisy(line: str) -> list[str]:
        return ["STAMP=99999", "\xff\x80noise", "R!", line, line.replace(":", "=")]

    fake.hooks["STAMP"] = noisy
    link.synchronise()
    assert list(link.events) == [Ready("")]


def test_a_reply_in_pieces_is_one_reply(link: Link, fake: Any) -> None:
    def pieces(line: str) -> list[str]:
        for byte in b"VER=MARS8 x\r\n":
            fake.write(bytes([byte]))
            time.sleep(0.002)
        return []

    fake.hooks["VER"] = pieces
    assert link.ask("VER") == "MARS8 x"


def test_optional_questions_cost_no_timeout(link: Link, fake: Any) -> None:
    link.identified = True
    fake.hooks["REGMS"] = lambda line: ["REGMSA=7680"] if line == "REGMSA?" else None
    begin = time.monotonic()
    assert link.ask_optional("REGMS", "A") == "7680"
    assert link.ask_optional("REGMS", "B") is None
    assert time.monotonic() - begin < 0.5


def test_silence_ends_by_the_deadline(link: Link, fake: Any) -> None:
    fake.mute = True
    begin = time.monotonic()
    with pytest.raises(NoAnswer, match="STAMP within 2 s"):
        link.synchronise()
    assert 0.9 < time.monotonic() - begin < 1.5  # 2 s of the controller, but never under 1 s of wall time


def test_events_of_fail(link: Link, fake: Any) -> None:
    fake.hooks["VER"] = lambda line: ["FAIL!", "VER=x"]
    link.ask("VER")
    assert list(link.events) == [Failed()]


def test_lines_go_no_faster_than_the_wire_carries_them(fake: Any, clock: Clock, link: Link) -> None:
    link.identified = True
    line = "HELP:" + "0" * 94  # 100 bytes with its end
    begin = clock.now()
    for _ in range(40):
        link.send(line)
    took = clock.now() - begin
    assert took > (4000 - 64) / BYTES_PER_SECOND
    assert took < 1.5 * 4000 / BYTES_PER_SECOND + 1.0


def test_stop_ends_a_half_sent_line_at_once() -> None:
    """Interrupted in the middle of a line on a slow wire: STOP is the next whole line, behind at most 64 bytes."""
    clock = Clock(1.0)
    master, slave = pty.openpty()
    tty.setraw(slave)
    link = Link(os.ttyname(slave), clock)
    link.identified = True

    def interrupt() -> None:
        time.sleep(0.03)
        import _thread

        _thread.interrupt_main()

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt):
        send_many(link, "COORDSPLINET:" + "1" * 86)
    link._write(b"COORDMV:1,2,3")  # wherever the interrupt has struck, this is the middle of a line
    link.send_stop()
    received = b""
    while not received.endswith(b"\nSTOP:\n") and select.select([master], [], [], 2.0)[0]:
        received += os.read(master, 65536)
    assert received.endswith(b"\nSTOP:\n")
    assert received.count(b":") < 5  # not the 30 lines that the system would have taken at once
    link.close()
    os.close(slave)
    os.close(master)


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("/dev/mars-that-is-not-there", "is not there"),
        ("/dev/null", "is not a serial line"),
        ("/tmp", "is a folder"),
        ("socket://127.0.0.1:9", "refused"),
        ("nonsense://x", "nonsense"),
        ("loop://", "must be a device, or socket://HOST:PORT"),
    ],
)
def test_a_port_that_cannot_be_opened_is_one_clear_line(url: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as refused:
        Link(url, Clock())
    assert url in str(refused.value)
    assert "\n" not in str(refused.value)


def test_two_programs_on_one_port(fake: Any, clock: Clock, link: Link, tmp_path: Path) -> None:
    other_name = tmp_path / "mars"
    other_name.symlink_to(fake.url)
    with pytest.raises(InputError, match="in use by another program"):
        Link(str(other_name), clock)
    link.synchronise()  # the first is not disturbed


def test_a_lost_port_is_told_and_stays_lost(fake: Any, clock: Clock, link: Link) -> None:
    link.identified = True
    fake.unplug()
    with pytest.raises(LinkLost, match="the link is lost"):
        link.synchronise()
    with pytest.raises(LinkLost):
        link.send("ST?")
    with pytest.raises(LinkLost):
        link.send_stop()


def test_a_unit_that_takes_no_bytes_is_an_error_not_a_hang() -> None:
    master, slave = pty.openpty()
    tty.setraw(slave)
    link = Link(os.ttyname(slave), Clock(1000.0))
    begin = time.monotonic()
    with pytest.raises(LinkLost):
        send_many(link, "VER?" + " " * 90)
    assert time.monotonic() - begin < 8.0
    link.close()
    os.close(slave)
    os.close(master)


def test_a_flood_of_noise_takes_bounded_memory(fake: Any, link: Link) -> None:
    for _ in range(200):
        fake.write(b"xxxxxxxxx\n" * 100)
    fake.write(b"y" * 100_000)
    deadline = time.monotonic() + 5.0
    while link._inbox.qsize() < 1000 and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(0.05)
    assert link._inbox.qsize() == 1000
    link.synchronise(attempts=2)


def test_a_flood_of_answers_ends_the_link(fake: Any, link: Link) -> None:
    """Answers are kept while they are few; a unit that sends thousands that nobody asked for is told as lost."""
    from driver.link import UNREAD_ANSWERS

    for _ in range(0, UNREAD_ANSWERS + 2000, 500):
        fake.write(b"ST=0\r\n" * 500)
        time.sleep(0.002)
    with pytest.raises(LinkLost, match="nobody asked for"):
        read_all(link)


def test_socket_urls_are_links_too(clock: Clock, tmp_path: Path) -> None:
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
