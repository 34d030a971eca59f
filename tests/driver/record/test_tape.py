"""The gate through which a recording sends, and what the tape keeps."""

from __future__ import annotations

import pytest

from arm.errors import A465Error
from driver.emulator.line.memory import MemoryLine
from driver.line.link import Link, LinkLost
from driver.line.stepped_clock import SteppedClock
from driver.record import tape
from driver.record.tape import Event, QuestionPort, Tape

NO = (
    b"STOP:\n",
    b"\nSTOP:\n",
    b"VER?",
    b"VER?\nST?\n",
    b"HHA:\n",
    b"STAMP:1\nREGMSA:5\n",
    b"VER?\r\n",
    b"\xffVER?\n",
    b"",
)


@pytest.mark.parametrize("data", NO)
def test_what_is_no_whole_question_does_not_pass(data: bytes) -> None:
    clock = SteppedClock()
    line, kept = MemoryLine(clock), Tape(clock)
    port = QuestionPort(line, kept)
    with pytest.raises(A465Error, match="a recording only asks"):
        port.write(data)
    assert (line.sent, kept.events) == ([], [])


def test_a_stop_does_not_pass_even_from_the_link_itself() -> None:
    clock = SteppedClock()
    line = MemoryLine(clock)
    link = Link(QuestionPort(line, Tape(clock)), clock)
    link.identified = True
    with pytest.raises(A465Error, match="a recording only asks"):
        link.send_stop()
    assert line.sent == []


def test_bytes_are_kept_with_their_times() -> None:
    clock = SteppedClock()
    line, kept = MemoryLine(clock, latency_s=0.01), Tape(clock)
    port = QuestionPort(line, kept)
    heard: list[bytes] = []
    port.listen(heard.append, lambda error: None)
    kept.step("first")
    clock.sleep(0.5)
    port.write(b"VER?\n")
    line.reply(b"VER=\xff\r\n")
    clock.sleep(0.5)
    assert kept.events == [
        Event(0.0, "step", "first"),
        Event(0.5, "sent", "VER?\n"),
        Event(0.51, "received", "VER=\xff\r\n"),
    ]
    assert heard == [b"VER=\xff\r\n"]
    assert (kept.heard, kept.heard_at) == ("VER=\xff\r\n", 0.51)
    assert [data for _, data in line.sent] == [b"VER?\n"]


def test_a_flood_ends_the_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tape, "MOST_BYTES", 1000)
    clock = SteppedClock()
    line, kept = MemoryLine(clock), Tape(clock)
    link = Link(QuestionPort(line, kept), clock)
    for _ in range(11):
        line.reply(bytes(100))
    with pytest.raises(LinkLost, match="flooded"):
        link.wait(1.0)
    assert len(kept.heard) == 1000
