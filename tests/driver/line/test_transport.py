"""The transport at the wire: pacing, deadlines, bounded memory, and a stop that is never behind."""

from __future__ import annotations

import os
import pty
import select
import threading
import time
import tty
from pathlib import Path
from typing import Any

import pytest

from arm.controller.unit import Unit
from driver.emulator import Emulator
from driver.line.clock import Clock
from driver.line.link import Link, LinkLost, NoAnswer
from driver.line.protocol import BYTES_PER_SECOND, Answer, Other
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from wire.whole_line import send_many


@pytest.fixture
def link(fake: Any, clock: SteppedClock) -> Any:
    link = Link(fake.line, clock)
    yield link
    link.close()


def read_all(link: Link) -> None:
    while link.receive(link.clock.now() + 1.0) is not None:
        pass


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
    monkeypatch.setattr("driver.line.clock.LEAST_WALL_S", 1.0)  # as it is
    with Emulator(unit, Clock(1000.0)) as emulator:
        link = Link(emulator.open_pty(), emulator.clock)
        begin = time.monotonic()
        with pytest.raises(NoAnswer, match="VER within 2 s"):
            link.await_answer("VER")
        assert time.monotonic() - begin >= 1.0
        link.close()


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


def test_a_lost_port_is_told_and_stays_lost(fake: Any, link: Link) -> None:
    link.identified = True
    fake.unplug()
    with pytest.raises(LinkLost, match="the link is lost"):
        link.synchronise()
    with pytest.raises(LinkLost):
        link.send("ST?")
    with pytest.raises(LinkLost):
        link.send_stop()


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
