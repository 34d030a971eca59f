"""A running stream against a scripted unit: how far ahead it is, what it asks, and what it survives."""

from __future__ import annotations

import re
from typing import Any

import pytest

from arms.wave_paths import wave
from driver.execution.progress import Progress, StreamOptions
from driver.line.clock import Clock
from driver.mars.mars import Mars
from driver.mars.streaming.feed import Feed
from driver.mars.streaming.stream import stream
from driver.mars.streaming.stream_run import LEAST_STEP_S
from wire.controlled_stream import splines
from wire.soft_home import SOFT_HOME


def test_never_more_than_the_look_ahead(mars: Mars, fake: Any) -> None:
    held: list[float] = []

    def watch(line: str) -> None:
        held.append(sum(end - max(begin, fake.clock.now()) for begin, end, _, _ in fake.queue))

    fake.hooks["COORDSPLINET"] = watch
    sent = stream(mars, wave(80))
    assert 1.0 < sent.ahead_s <= 1.5
    assert max(held) <= 1.5
    sent = stream(mars, wave(40, start=mars.reference or SOFT_HOME), options=StreamOptions(ahead_s=0.5))
    assert sent.ahead_s <= 1.2  # what noticing and stopping need is not given up


def test_never_more_segments_than_the_queue_takes(mars: Mars, fake: Any) -> None:
    most = [0]

    def watch(line: str) -> None:
        most[0] = max(most[0], len(fake.queue) + 1)

    fake.hooks["COORDSPLINET"] = watch
    stream(mars, wave(60), options=StreamOptions(dwell_ms=4000, ahead_s=100.0, queue=20))
    assert 15 <= most[0] <= 20


def test_segments_longer_than_the_look_ahead_go_one_behind_the_other(mars: Mars, fake: Any) -> None:
    path = wave(4, duration_ms=2000)
    sent = stream(mars, path)
    assert sent.end_counts == path.end
    assert sent.ahead_s <= 4.5  # with the dwell


@pytest.mark.parametrize("before_wrap", [32757, 65530])
def test_segment_numbers_may_wrap(mars: Mars, fake: Any, before_wrap: int) -> None:
    fake.sequence = before_wrap
    seen: list[Progress] = []
    stream(mars, wave(40), seen.append)
    done = [p.done for p in seen]
    assert done == sorted(done)
    assert len(set(done)) > 10
    assert seen[-1].planned_s == pytest.approx(seen[-1].done * 0.1)


def test_an_idle_unit_may_show_any_segment_number(mars: Mars, fake: Any, clock: Clock) -> None:
    """Between a starved stop and the next segment the number is unknown; only the status tells that all is done."""

    def idle_zero(line: str) -> list[str] | None:
        fake.advance()
        if fake.queue:
            return None
        return [f"COORDAP={int(fake.clock.now() * 1e3) % 65536},0,0," + ",".join(str(c) for c in fake.counts)]

    fake.hooks["COORDAP"] = idle_zero
    path = wave(30)
    stalled = []

    def stall(progress: Progress) -> None:
        if progress.done >= 10 and not stalled:
            stalled.append(progress)
            clock.sleep(3.0)  # longer than the look-ahead: the unit runs dry

    assert stream(mars, path, stall).end_counts == path.end
    assert stalled


def test_damaged_answers_are_survived(mars: Mars, fake: Any) -> None:
    """Every seventh answer is garbled, cut, doubled or lost."""
    count = [0]

    def damage(line: str) -> list[str] | None:
        count[0] += 1
        if count[0] % 7:
            return None
        return [["COORDAP=1,2,,x"], ["ORDAP=7"], ["", "\xff"], []][count[0] // 7 % 4]

    fake.hooks["COORDAP"] = damage
    path = wave(60)
    assert stream(mars, path).end_counts == path.end
    assert count[0] > 20


def test_one_wrong_digit_in_a_position_is_survived(mars: Mars, fake: Any) -> None:
    wrong: list[str] = []

    def once(line: str) -> list[str] | None:
        if len(splines(fake.lines)) < 12 or wrong:
            return None
        at = fake.at()
        wrong.append(f"COORDAP=1,{fake.sequence},1," + ",".join(str(c) for c in (at[0] + 100_000, *at[1:])))
        return wrong

    fake.hooks["COORDAP"] = once
    path = wave(40)
    assert stream(mars, path).end_counts == path.end
    assert wrong


def test_a_unit_that_does_not_number_its_segments_is_served_in_portions(mars: Mars, fake: Any) -> None:
    """Only the status then tells that everything sent is done: slower, but never further ahead."""
    fake.hooks["COORDAP"] = lambda line: ["COORDAP=1,7,1," + ",".join(str(c) for c in fake.at())]
    path = wave(40)
    sent = stream(mars, path)
    assert sent.end_counts == path.end
    assert sent.ahead_s <= 1.5


@pytest.mark.parametrize("stall_s", [0.5, 3.0])
def test_a_host_that_sleeps_is_survived(mars: Mars, fake: Any, clock: Clock, stall_s: float) -> None:
    asleep: list[int] = []

    def sleep(progress: Progress) -> None:
        if progress.done > 15 and not asleep:
            asleep.append(progress.done)
            clock.sleep(stall_s)

    path = wave(60)
    sent = stream(mars, path, sleep)
    assert sent.end_counts == path.end
    assert asleep


def test_a_dwell_that_was_missed_is_given_again(
    mars: Mars, fake: Any, clock: Clock, monkeypatch: Any
) -> None:
    dwell, slow = Feed.dwell, [True]

    def late(self: Feed) -> None:
        dwell(self)
        if slow:
            slow.clear()
            clock.sleep(1.0)

    monkeypatch.setattr(Feed, "dwell", late)
    path = wave(10)
    assert stream(mars, path).end_counts == path.end
    dwells = [line for line in splines(fake.lines) if re.fullmatch(r"COORDSPLINET:\d+,3(,0){18}", line)]
    first, second = (int(d.split(",")[0].removeprefix("COORDSPLINET:")) for d in dwells)
    assert second == pytest.approx(2 * first, abs=30)


def test_a_failure_that_an_earlier_wait_asked_for_does_not_end_the_next_motion(mars: Mars, fake: Any) -> None:
    """It was on its way when the motion began."""
    fake.hooks["COORDDISCONT"] = lambda line: fake.write(b"FAIL!\r\n")
    assert stream(mars, wave(5)).end_counts == wave(5).end


def test_the_end_is_asked_for_once_where_it_is_answered_however_long_the_last_motion_takes(
    mars: Mars, fake: Any
) -> None:
    path = wave(80)
    assert stream(mars, path, options=StreamOptions(ahead_s=6.0, queue=200)).path == path
    assert fake.lines.count("R:") == 1


def test_a_stream_sleeps_between_what_it_has_to_do(mars: Mars, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []
    plain = mars.link.receive

    def receive(until: float) -> Any:
        began = mars.clock.now()
        if until > began:
            waits.append(until - began)
        return plain(until)

    monkeypatch.setattr(mars.link, "receive", receive)
    stream(mars, wave(20))
    assert min(waits) >= LEAST_STEP_S - 1e-9
