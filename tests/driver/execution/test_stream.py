"""Streaming against a scripted unit: what is sent, how far ahead, and every way it can end early."""

from __future__ import annotations

import os
import re
import signal
from dataclasses import replace
from typing import Any

import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arms.wave_paths import wave
from driver.execution.extremes import extremes
from driver.execution.feed import Feed
from driver.execution.progress import Progress, StreamOptions
from driver.execution.stream import stream
from driver.execution.stream_run import LEAST_STEP_S
from driver.line.clock import Clock
from driver.mars.mars import Mars
from wire.soft_home import SOFT_HOME


@pytest.fixture
def mars(fake: Any, unit: Unit, clock: Clock) -> Any:
    fake.counts = list(SOFT_HOME)
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        mars.initialise(home=False)
        mars.move_to(SOFT_HOME)
        fake.lines.clear()
        yield mars


def splines(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith(("COORDSPLINET", "COORDMVT"))]


def test_the_wire_carries_the_path_to_the_count(mars: Mars, fake: Any) -> None:
    path = wave(60)
    sent = stream(mars, path)
    dwell, *moved = splines(fake.lines)
    assert re.fullmatch(r"COORDSPLINET:(3|4)\d\d,3," + ",".join(["0"] * 18), dwell)
    for line, segment in zip(moved, path.segments, strict=True):
        ms, order, *values = (int(v) for v in line.split(":")[1].split(","))
        assert (ms, order) == (100, 3)
        assert tuple(tuple(values[i::3]) for i in range(3)) == segment.coefficients
    assert sent.path == path
    assert sent.end_counts == path.end == mars.counts() == mars.reference
    assert fake.lines.count("COORDDISCONT:5") == 1
    assert sent.duration_s == pytest.approx(6.0, abs=0.1)


def test_a_second_path_needs_no_anchor_and_no_registers(mars: Mars, fake: Any) -> None:
    first = wave(5)
    stream(mars, first)
    second = wave(5, start=first.end, seed=2)
    stream(mars, second)
    assert not any(line.startswith(("COORDMV:", "REG")) for line in fake.lines)


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


def test_straight_segments_go_as_absolute_moves(mars: Mars, fake: Any) -> None:
    path = CountPath(SOFT_HOME, tuple(Segment(60, ((100, -50, 0, 3, 2, 1),)) for _ in range(10)))
    assert stream(mars, path).end_counts == path.end
    last = ",".join(str(c) for c in path.end)
    assert splines(fake.lines)[-1] == f"COORDMVT:60,{last}"


def test_a_path_from_elsewhere_moves_nothing(mars: Mars, fake: Any) -> None:
    with pytest.raises(ImpossibleError, match="starts 26 counts from the arm"):
        stream(mars, wave(5, start=(SOFT_HOME[0] - 26, *SOFT_HOME[1:])))
    assert splines(fake.lines) == []


def test_a_path_from_a_few_counts_off_is_anchored(mars: Mars, fake: Any) -> None:
    path = wave(5, start=(SOFT_HOME[0] + 20, *SOFT_HOME[1:]))
    assert stream(mars, path).end_counts == path.end
    absolute = [line for line in fake.lines if line.startswith("COORDMV:")]
    assert absolute == ["COORDMV:" + ",".join(map(str, c)) for c in (SOFT_HOME, path.start)]


def test_a_path_that_bulges_out_of_the_limits_moves_nothing(mars: Mars, fake: Any) -> None:
    """Both ends of the segment are inside; the cubic between them is not."""
    bulge = Segment(1000, ((0,) * 6, (0, 600_000, 0, 0, 0, 0), (0, -600_000, 0, 0, 0, 0)))
    _, high = extremes(CountPath(SOFT_HOME, (bulge,)))
    assert high[1] - SOFT_HOME[1] == pytest.approx(600_000 * 4 / 27, abs=1.0)
    over = Segment(1000, ((0,) * 6, (0, 900_000, 0, 0, 0, 0), (0, -900_000, 0, 0, 0, 0)))
    with pytest.raises(ImpossibleError, match=r"the path reaches .* deg on axis B"):
        stream(mars, CountPath(SOFT_HOME, (over,)))
    assert splines(fake.lines) == []


def test_segments_that_cannot_be_sent_are_found_before_any_is(mars: Mars, fake: Any) -> None:
    good = wave(5)
    bad = CountPath(SOFT_HOME, (*good.segments, Segment(0, good.segments[0].coefficients)))
    with pytest.raises(InputError, match="0 ms"):
        stream(mars, bad)
    with pytest.raises(InputError, match="no segments"):
        stream(mars, CountPath(SOFT_HOME, ()))
    assert splines(fake.lines) == []


# -- ends before the end


def at_segment(fake: Any, number: int, do: Any) -> None:
    """Do something when that many spline lines have come (the dwell is the first)."""
    count = [0]

    def hook(line: str) -> None:
        count[0] += 1
        if count[0] == number:
            do()

    fake.hooks["COORDSPLINET"] = hook


@pytest.mark.parametrize(
    ("bits", "said"),
    [(0x10000, "arm power is off"), (0x20000, "motion stop is pressed"), (0x8, "an axis is in error")],
)
def test_a_fault_stops_the_stream(mars: Mars, fake: Any, bits: int, said: str) -> None:
    at_segment(fake, 12, lambda: setattr(fake, "status_bits", bits))
    with pytest.raises(ExecutionStopped, match=f"stream: segment [0-9]+ of 60: {said}") as stopped:
        stream(mars, wave(60))
    data = stopped.value.data
    assert data["reason"] == "fault"
    assert data["state"]["status"] & bits
    assert data["segments_done"] <= data["segments_sent"] < 40
    assert splines(fake.since("STOP:")) == []
    assert not any(line.startswith("RELEASE") for line in fake.lines)
    assert mars.reference is None


def test_fail_stops_the_stream(mars: Mars, fake: Any) -> None:
    at_segment(fake, 12, lambda: fake.write(b"FAIL!\r\n"))
    with pytest.raises(ExecutionStopped, match="FAIL!"):
        stream(mars, wave(60))
    assert splines(fake.since("STOP:")) == []


def test_a_silent_unit_stops_the_stream(mars: Mars, fake: Any) -> None:
    at_segment(fake, 20, lambda: setattr(fake, "mute", True))
    with pytest.raises(
        ExecutionStopped, match=r"no valid answer from the unit|no echo of segment"
    ) as stopped:
        stream(mars, wave(120))
    assert stopped.value.data["ahead_s"] <= 1.5
    assert splines(fake.since("STOP:")) == []
    assert len(splines(fake.lines)) < 50


def test_a_port_that_goes_away_ends_the_stream(mars: Mars, fake: Any) -> None:
    at_segment(fake, 20, fake.unplug)
    with pytest.raises(ExecutionStopped, match="the link is lost") as stopped:
        stream(mars, wave(120))
    assert stopped.value.data["state"]["at_rest"] is False
    assert stopped.value.data["ahead_s"] <= 1.5


def test_a_stuck_axis_stops_the_stream(mars: Mars, fake: Any) -> None:
    def stuck(line: str) -> list[str]:
        at = fake.at()
        sequence = fake.sequence - max(len(fake.queue) - 1, 0)
        return [
            f"COORDAP={int(1e3 * fake.clock.now()) % 65536},{sequence},1,"
            + ",".join(str(c) for c in (*at[:3], SOFT_HOME[3], *at[4:]))
        ]

    fake.hooks["COORDAP"] = stuck
    path = CountPath(SOFT_HOME, tuple(Segment(100, ((100, 20, 50, -300, 10, 10),)) for _ in range(40)))
    with pytest.raises(ExecutionStopped, match=r"axis D is .* counts off its path") as stopped:
        stream(mars, path)
    assert stopped.value.data["axis"] == "D"
    assert stopped.value.data["segments_done"] < 20


def test_a_unit_that_stands_still_ends_by_the_deadline(mars: Mars, fake: Any) -> None:
    at_segment(fake, 6, lambda: fake.queue.append((0.0, 1e9, list(SOFT_HOME), list(SOFT_HOME))))
    with pytest.raises(ExecutionStopped, match="has not ended 5 s after its planned end") as stopped:
        stream(mars, wave(10), options=StreamOptions(following_counts=10**6))
    assert stopped.value.data["reason"] == "deadline"


def test_an_end_elsewhere_is_told(mars: Mars, fake: Any) -> None:
    at_segment(fake, 10, lambda: fake.offset.__setitem__(2, 30))
    with pytest.raises(ExecutionStopped, match="settled 30 counts from the target"):
        stream(mars, wave(10))


def test_the_tolerance_at_rest_is_the_units_and_what_was_read_is_told(mars: Mars, fake: Any) -> None:
    usual = mars.unit
    at_segment(fake, 10, lambda: fake.offset.__setitem__(2, 220))
    mars.unit = replace(usual, rest_tolerance=250)
    end = stream(mars, wave(10)).end_counts
    assert end[2] - wave(10).end[2] == 220
    mars.unit = usual
    with pytest.raises(ExecutionStopped, match=r"at most 25|where the last motion ended") as stopped:
        stream(mars, wave(10))
    assert f"C reads {end[2]}, +220 (-0.20 deg)" in str(stopped.value)


def test_an_interrupt_stops_the_stream(mars: Mars, fake: Any) -> None:
    at_segment(fake, 20, lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(ExecutionStopped, match="stream: interrupted; the arm has stopped") as stopped:
        stream(mars, wave(200))
    assert stopped.value.data["reason"] == "interrupted"
    assert splines(fake.since("STOP:")) == []


def test_an_error_in_the_callers_own_code_stops_the_arm(mars: Mars, fake: Any) -> None:
    def broken(progress: Progress) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        stream(mars, wave(60), broken)
    mars.link.synchronise()
    assert splines(fake.since("STOP:")) == []


# -- survivable


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
