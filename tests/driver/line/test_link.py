"""The link at the wire: gates, order, deadlines, pacing, and a stop that is never behind."""

from __future__ import annotations

from typing import Any

import pytest

from arm.errors import A465Error
from driver.line.link import LineDamaged, Link, NoAnswer
from driver.line.protocol import Failed, Ready
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars


@pytest.fixture
def link(fake: Any, clock: SteppedClock) -> Any:
    link = Link(fake.line, clock)
    yield link
    link.close()


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


def test_events_of_fail(link: Link, fake: Any) -> None:
    fake.hooks["VER"] = lambda line: ["FAIL!", "VER=x"]
    link.ask("VER")
    assert list(link.events) == [Failed()]


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
