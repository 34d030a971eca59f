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

from arm.controller.unit import Unit
from arm.errors import A465Error, InputError
from driver.emulator import Emulator
from driver.line.clock import Clock
from driver.line.link import LineDamaged, Link, LinkLost, NoAnswer
from driver.line.protocol import BYTES_PER_SECOND, Answer, Failed, Other, Ready
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars


@pytest.fixture
def link(fake: Any, clock: SteppedClock) -> Any:
    link = Link(fake.line, clock)
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
    with pytest.raises(A465Error, match="is not identified"):
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
        return []

    fake.hooks["VER"] = pieces
    assert link.ask("VER") == "MARS8 x"


def test_optional_questions_cost_no_timeout(link: Link, fake: Any) -> None:
    link.identified = True
    fake.hooks["REGMS"] = lambda line: ["REGMSA=7680"] if line == "REGMSA?" else None
    begin = link.clock.now()
    assert link.ask_optional("REGMS", "A") == "7680"
    assert link.ask_optional("REGMS", "B") is None
    assert link.clock.now() - begin < 0.1


def test_silence_ends_by_the_deadline(link: Link, fake: Any) -> None:
    fake.mute = True
    begin = link.clock.now()
    with pytest.raises(NoAnswer, match="STAMP within 2 s"):
        link.synchronise()
    assert 2.0 <= link.clock.now() - begin < 2.01


def test_a_host_that_is_busy_is_given_a_second_of_wall_time(
    unit: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However fast the emulated unit lives: 2 s of its time are 2 ms here."""
    monkeypatch.setattr("driver.line.transport.LEAST_WALL_S", 1.0)  # as it is
    with Emulator(unit, Clock(1000.0)) as emulator:
        link = Link(emulator.open_pty(), emulator.clock)
        begin = time.monotonic()
        with pytest.raises(NoAnswer, match="VER within 2 s"):
            link.await_answer("VER")
        assert time.monotonic() - begin >= 1.0
        link.close()


def test_events_of_fail(link: Link, fake: Any) -> None:
    fake.hooks["VER"] = lambda line: ["FAIL!", "VER=x"]
    link.ask("VER")
    assert list(link.events) == [Failed()]


def test_lines_go_no_faster_than_the_wire_carries_them(fake: Any, clock: SteppedClock, link: Link) -> None:
    link.identified = True
    line = "HELP:" + "0" * 94  # 100 bytes with its end
    begin = clock.now()
    for _ in range(40):
        link.send(line)
    took = clock.now() - begin
    assert took == pytest.approx((4000 - 64) / BYTES_PER_SECOND, abs=1e-4)
    free_at = 0.0
    for at, data in fake.line.sent:
        free_at = max(free_at, at) + len(data) / BYTES_PER_SECOND
        assert (free_at - at) * BYTES_PER_SECOND <= 64.01


def test_stop_ends_a_half_sent_line_at_once() -> None:
    """Interrupted in the middle of a line on a real port: STOP is the next whole line."""
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


def test_two_programs_on_one_port(unit: Unit, tmp_path: Path) -> None:
    with Emulator(unit, Clock(1.0)) as emulator:
        url = emulator.open_pty()
        link = Link(url, emulator.clock)
        other_name = tmp_path / "mars"
        other_name.symlink_to(url)
        with pytest.raises(InputError, match="in use by another program"):
            Link(str(other_name), emulator.clock)
        link.synchronise()  # the first is not disturbed
        link.close()


def test_a_lost_port_is_told_and_stays_lost(fake: Any, link: Link) -> None:
    link.identified = True
    fake.unplug()
    with pytest.raises(LinkLost, match="the link is lost"):
        link.synchronise()
    with pytest.raises(LinkLost):
        link.send("ST?")
    with pytest.raises(LinkLost):
        link.send_stop()


def test_a_unit_that_takes_no_bytes_is_an_error_not_a_hang(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("driver.line.transport.LEAST_WALL_S", 1.0)  # as it is
    master, slave = pty.openpty()
    tty.setraw(slave)
    link = Link(os.ttyname(slave), Clock(1000.0))
    with pytest.raises(LinkLost):
        send_many(link, "VER?" + " " * 90)
    link.close()
    os.close(slave)
    os.close(master)


def test_a_flood_of_noise_takes_bounded_memory(fake: Any, link: Link) -> None:
    for _ in range(200):
        fake.write(b"xxxxxxxxx\n" * 100)
    fake.write(b"y" * 100_000)
    link.clock.sleep(1.0)
    assert link._inbox.qsize() == 1000
    link.synchronise(attempts=2)


def test_an_endless_line_is_not_kept(fake: Any, link: Link) -> None:
    """A megabyte without a line end: nothing of it is handed over as a line, and the next answer is understood."""
    for _ in range(1_000_000 // 500):
        fake.write(b"y" * 500)
    link.clock.sleep(1.0)
    assert len(link._splitter._rest) <= 1024
    fake.write(b"\nVER=MARS8\r\n")
    told = []
    while (reply := link.receive(link.clock.now() + 1.0)) is not None:
        told.append(reply)
    assert told[-1] == Answer("VER", "MARS8")
    assert all(isinstance(r, Other) and len(r.text) <= 2048 for r in told[:-1])


def test_a_line_as_long_as_any_answer_is_kept(fake: Any, link: Link) -> None:
    """However the port cuts it into pieces."""
    for piece in (b"VER=", *[b"x" * 100] * 10, b"\r\n"):
        fake.write(piece)
    assert link.await_answer("VER") == "x" * 1000


def test_a_flood_of_answers_ends_the_link(fake: Any, link: Link) -> None:
    """Answers are kept while they are few; a unit that sends thousands that nobody asked for is told as lost."""
    from driver.line.transport import UNREAD_ANSWERS

    for _ in range(0, UNREAD_ANSWERS + 2000, 500):
        fake.write(b"ST=0\r\n" * 500)
    link.clock.sleep(1.0)
    with pytest.raises(LinkLost, match="unexpected lines"):
        read_all(link)


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


def test_after_a_stop_lines_are_awaited_again_once_all_is_known_to_be_obeyed(mars: Mars, fake: Any) -> None:
    link = mars.link
    link.send_stop()
    assert not link.echo.strict
    link.synchronise()
    assert link.echo.strict
    fake.write = lambda data, write=fake.write: write(data.replace(b"100", b"900"))
    link.send("COORDMV:100,2,3,4,5,6")
    with pytest.raises(LineDamaged, match="echo 'COORDMV:900"):
        link.synchronise()


def test_a_register_that_was_lost_once_is_sent_once_more_and_a_silent_unit_is_asked_twice(
    mars: Mars, fake: Any
) -> None:
    link, write = mars.link, fake.write
    fake.write = lambda data: write(data.replace(b"7680", b"7681") if fake.lines.count(lost) == 0 else data)
    lost = "REGMSA:7680"
    fake.lines.clear()
    link.tell(lost, "REGMSB:7680")
    assert [line for line in fake.lines if line.startswith("REG")].count(lost) == 2
    fake.mute = True
    fake.lines.clear()
    with pytest.raises(NoAnswer, match="no answer to STAMP"):
        link.tell("REGMSA:7680")
    assert sum(line.startswith("STAMP:") for line in fake.lines) == 2


@pytest.mark.parametrize("logged", [False, True])
def test_a_unit_that_begins_to_mix_echoes_and_answers_is_spoken_to_in_turns_from_then_on(
    mars: Mars, fake: Any, clock: SteppedClock, tmp_path: Path, logged: bool
) -> None:
    link, motion = mars.link, b"COORDMV:1,2,3,4,5,6"
    with WireLog(tmp_path / "log.jsonl", clock) as log:
        link.log = log if logged else None
        assert not link.takes_turns
        fake.write = lambda data: None
        link.send("ST?")
        link.send(motion.decode())
        fake.line.reply(b"ST?\n" + motion[:9] + b"ST=0\r\n" + motion[9:] + b"\n")
        assert link.await_answer("ST") == "0"
        link.log = None
    assert link.takes_turns
    assert ("takes_turns" in (tmp_path / "log.jsonl").read_text()) is logged
