"""Feeding a motion: a segment goes out while a damaged one could still be stopped, and a host asleep is told."""

from __future__ import annotations

from math import inf
from types import SimpleNamespace
from typing import Any

import pytest

from arm.controller.unit import load_unit
from driver.execution.progress import StreamOptions
from driver.line.link import NoAnswer
from driver.line.protocol import BYTES_PER_SECOND, MAX_LINE
from driver.line.stepped_clock import SteppedClock
from driver.mars.lookahead import ANSWERS_BYTES
from driver.mars.streaming.feed import ANSWER_S, DWELLS, LATE_S, LONGEST_POLL_S, Feed

USUAL = StreamOptions()
LINE = "COORDMVT:100," + ",".join(["1000"] * 6)


def feed_over(
    trip_s: float,
    unechoed_bytes: int = 0,
    takes_turns: bool = False,
    options: StreamOptions = USUAL,
    line_free_at: float = 0.0,
) -> tuple[Feed, list[str]]:
    """Over a line that only counts what is sent; ten segments of 0.1 s."""
    unit, sent = load_unit("crs93"), list[str]()

    def send(line: str) -> int:
        sent.append(line)
        return len(sent)

    link: Any = SimpleNamespace(
        echo=SimpleNamespace(round_trip_s=trip_s, unechoed_bytes=unechoed_bytes, verified=0),
        trip_s=trip_s,
        clock=SteppedClock(),
        echoes=True,
        takes_turns=takes_turns,
        stop_delivery_s=0.05 + trip_s / 2.0,
        line_free_at=line_free_at,
        send=send,
    )
    mars: Any = SimpleNamespace(
        link=link,
        unit=unit,
        speed_registers=unit.speed_registers,
        acceleration_registers=unit.acceleration_registers,
    )
    feed = Feed(mars, options)
    feed.plan([LINE] * 10, [0.1] * 10)
    return feed, sent


@pytest.mark.parametrize("trip_s", [0.0, 0.03, 0.2])
@pytest.mark.parametrize("unechoed_bytes", [0, 60, 150])
def test_a_segment_is_sent_while_its_echo_can_come_before_a_stop_has_to_go(
    trip_s: float, unechoed_bytes: int
) -> None:
    """The unit has the line's last byte, then echoes what waits there, a look's answers, and the line."""
    feed, _ = feed_over(trip_s, unechoed_bytes)
    size = len(LINE) + 1
    waiting = max(unechoed_bytes - trip_s * BYTES_PER_SECOND, 0.0)
    echoed_s = size / BYTES_PER_SECOND + trip_s + (waiting + ANSWERS_BYTES + size) / BYTES_PER_SECOND
    for spare_s in (-2e-3, 2e-3):
        feed.timeline.stands(0, echoed_s + feed.needs.last_s(0.0) + spare_s)
        assert feed.in_time() is (spare_s > 0.0)


@pytest.mark.parametrize("trip_s", [0.0, 0.03, 0.1, 0.15])
def test_looks_leave_half_of_a_line_of_turns_to_segments(trip_s: float) -> None:
    """A look takes the line for three round trips: the echoes that are out, its questions, its answers."""
    free, turns = (feed_over(trip_s, takes_turns=takes)[0] for takes in (False, True))
    assert ANSWERS_BYTES / BYTES_PER_SECOND <= ANSWER_S <= 1.5 * ANSWERS_BYTES / BYTES_PER_SECOND
    look_s = 3.0 * (trip_s + ANSWER_S)
    assert free.poll_s == StreamOptions().poll_s
    assert turns.poll_s == pytest.approx(min(2.0 * look_s, LONGEST_POLL_S))
    assert turns.ahead_s >= min(free.ahead_s + look_s, LONGEST_POLL_S)


def test_a_host_that_gets_nothing_out_in_time_is_told_after_a_few_dwells_each_twice_as_long() -> None:
    feed, sent = feed_over(0.03)
    for _ in range(DWELLS):
        feed.dwell()
    lengths = [int(line.split(":")[1].split(",")[0]) for line in sent]
    assert lengths == pytest.approx([lengths[0] * 2**k for k in range(DWELLS)], abs=2**DWELLS)
    with pytest.raises(NoAnswer, match=f"no segment could be sent in time in {DWELLS} dwells"):
        feed.dwell()
    assert len(sent) == DWELLS


def test_dwells_with_motion_between_them_are_not_counted_together() -> None:
    feed, sent = feed_over(0.03)
    for _ in range(DWELLS + 2):
        feed.dwell()
        feed.send()
    lengths = [int(line.split(":")[1].split(",")[0]) for line in sent[::2]]
    assert max(lengths) < 2 * lengths[0]


def test_of_a_motion_that_is_loaded_first_nothing_may_begin_before_all_of_it_came_back() -> None:
    feed, _ = feed_over(0.03, options=StreamOptions(preload=True), line_free_at=4.9)
    feed.dwell()
    feed.timeline.stands(0, 5.0)
    for _ in range(8):
        feed.send()
    assert feed.decide_at() == pytest.approx(5.0 - feed.needs.last_s(0.0))
    feed._link.echo.verified = 8  # of nine lines, the dwell the first: seven segments
    assert feed.decide_at() == pytest.approx(5.0 - feed.needs.last_s(0.0))
    feed._link.echo.verified = 9
    assert feed.decide_at() == inf


def test_what_is_loaded_and_late_is_not_waited_for_until_the_dwell_is_over() -> None:
    feed, _ = feed_over(0.03, options=StreamOptions(preload=True))
    feed.dwell()
    feed.timeline.stands(0, 50.0)
    feed.send()
    assert feed.decide_at() == pytest.approx(feed.needs.echo_s(MAX_LINE, 0) + LATE_S)
    feed.end_loading()
    usual, _ = feed_over(0.03)
    usual.dwell()
    usual.timeline.stands(0, 50.0)
    usual.send()
    assert usual.decide_at() == pytest.approx(50.0 - usual.needs.last_s(0.0))
