"""Streaming against a scripted unit: what is sent, how far ahead, and every way it can end early."""

from __future__ import annotations

import os
import re
import signal
from dataclasses import replace
from typing import Any

import pytest

from arm.controller.segments import CountPath, Segment
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arms.wave_paths import wave
from driver.execution.progress import Progress, StreamOptions
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from wire.controlled_stream import splines
from wire.soft_home import SOFT_HOME


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
    _, high = CountPath(SOFT_HOME, (bulge,)).extremes()
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


@pytest.mark.parametrize(("off", "stops"), [(230, True), (-225, False), (225, False)])
def test_a_motion_whose_load_may_touch_something_may_end_held_back(
    mars: Mars, fake: Any, off: int, stops: bool
) -> None:
    """So far and no further; once the load is gone, the next motion begins where this one was sent."""
    at_segment(fake, 10, lambda: fake.offset.__setitem__(2, off))
    options = StreamOptions(held_back_counts=200)
    if stops:
        with pytest.raises(ExecutionStopped, match="settled 230 counts from the target, must be at most 225"):
            stream(mars, wave(10), options=options)
        return
    assert stream(mars, wave(10), options=options).end_counts[2] - wave(10).end[2] == off
    fake.offset[2] = 0
    assert mars.reference == wave(10).end
    stream(mars, wave(5, start=wave(10).end, seed=2))


def test_an_interrupt_stops_the_stream(mars: Mars, fake: Any) -> None:
    at_segment(fake, 20, lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(ExecutionStopped, match="stream interrupted; the arm has stopped") as stopped:
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
