"""Pause, abort and override of a stream, at the wire of a scripted unit."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, InputError
from driver.execution.control import LEAST_OVERRIDE, Control
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.execution.speed_override import stretched
from driver.execution.stream import stream
from driver.line.clock import Clock
from driver.line.protocol import BYTES_PER_SECOND
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from wire.soft_home import SOFT_HOME


@pytest.fixture
def mars(fake: Any, unit: Unit, clock: Clock) -> Any:
    yield from opened(fake, unit, clock)


def opened(fake: Any, unit: Unit, clock: Clock) -> Any:
    fake.counts = list(SOFT_HOME)
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        mars.initialise(home=False)
        mars.move_to(SOFT_HOME)
        fake.lines.clear()
        fake.times.clear()
        yield mars


def run(segments: int, duration_ms: int = 100) -> CountPath:
    """At constant speed, as cubics."""
    zero = (0,) * 6
    return CountPath(SOFT_HOME, (Segment(duration_ms, ((100, 20, -30, 5, 0, 0), zero, zero)),) * segments)


def moved(fake: Any) -> list[str]:
    """The segments received, without the dwell."""
    return [x for x in fake.lines if x.startswith("COORD") and "COORDSPLINET" in x][1:]


class Script:
    """Does one thing after another as the motion goes on: each when its condition holds."""

    def __init__(self, *acts: tuple[Callable[[Progress], bool], Callable[[], None]]) -> None:
        self.acts = list(acts)

    def __call__(self, progress: Progress) -> None:
        if self.acts and self.acts[0][0](progress):
            self.acts.pop(0)[1]()


def reaches(done: int) -> Callable[[Progress], bool]:
    return lambda progress: progress.done >= done


# -- pause


def paused_and_continued(mars: Mars, fake: Any, control: Control) -> tuple[Sent, list[int], list[list[int]]]:
    """Stream 60 segments with a pause at segment 20 of 25 s standing; what was sent before, and where it stood."""
    counted: list[int] = []
    stood: list[list[int]] = []
    since: list[float] = []

    def stands(progress: Progress) -> bool:
        if control.standing:
            since.append(mars.clock.now())
            stood.append(list(fake.at()))
        return bool(since) and mars.clock.now() > since[0] + 25.0

    def pause() -> None:
        control.pause()
        counted.append(len(moved(fake)))

    def go_on() -> None:
        counted.append(len(moved(fake)))
        control.go_on()

    return stream(mars, run(60), Script((reaches(20), pause), (stands, go_on)), None, control), counted, stood


def test_a_pause_runs_out_on_the_path_and_goes_on_with_the_same(mars: Mars, fake: Any) -> None:
    told: list[str] = []
    path, control = run(60), Control(tell=told.append)
    sent, counted, stood = paused_and_continued(mars, fake, control)
    assert counted[0] == counted[1]  # nothing at all was fed meanwhile
    assert {tuple(s) for s in stood} == {tuple(path.knots()[counted[0]])}  # at the last point that was sent
    assert counted[0] - 20 <= 15 + 2  # the look-ahead, and the age of the look
    assert sent.path == path
    assert sent.end_counts == path.end
    stood_again = [k for k, line in enumerate(moved(fake)) if line.endswith(",3" + ",0" * 18)]
    assert stood_again == [counted[0]]  # what follows can be verified before it begins
    lines = [line for line in moved(fake) if not line.endswith(",3" + ",0" * 18)]
    for line, segment in zip(lines, path.segments, strict=True):
        assert line == "COORDSPLINET:100,3," + ",".join(
            str(row[a]) for a in range(6) for row in segment.coefficients
        )
    assert not any(line.startswith(("STOP", "COORDMV:", "RELEASE")) for line in fake.lines)
    assert told[0].startswith("pausing: the arm keeps moving for about 1.")
    assert told[1:] == [
        "paused: the arm has stopped and is still under power",
        "resuming: the arm moves again",
    ]
    assert control.standing is False


def test_a_pause_that_ends_before_the_arm_stands_costs_nothing(mars: Mars, fake: Any) -> None:
    control = Control()
    path = run(40)
    sent = stream(
        mars, path, Script((reaches(10), control.pause), (reaches(12), control.go_on)), None, control
    )
    assert sent.path == path
    assert sent.duration_s < path.duration_s + 0.1
    assert control.standing is False


def test_a_slower_speed_does_not_begin_in_motion_though_the_pause_is_over(mars: Mars, fake: Any) -> None:
    """In motion it would be a jump of the speed: it is that of the next motion."""
    path, control = run(40), Control()

    def slower() -> None:
        control.pause()
        control.override = 0.5

    sent = stream(mars, path, Script((reaches(10), slower), (reaches(12), control.go_on)), None, control)
    assert sent.path == path
    assert {line.split(",")[0] for line in moved(fake)} == {"COORDSPLINET:100"}
    assert control.override == 0.5


def test_a_slower_speed_of_a_pause_is_that_of_all_that_is_left(mars: Mars, fake: Any) -> None:
    """On the wire, and in what progress is counted by: a look-ahead in seconds of then."""
    path, control = run(60), Control()
    planned: list[float] = []

    def slower() -> None:
        control.override = 0.5
        control.go_on()

    notes: list[tuple[str, Any]] = []
    plain = mars.note
    mars.note = lambda what, **data: (notes.append((what, data)), plain(what, **data))[-1]  # type: ignore[method-assign]
    script = Script((reaches(10), control.pause), (lambda p: control.standing, slower))

    def each(progress: Progress) -> None:
        script(progress)
        planned.append(progress.planned_s)

    stream(
        mars,
        path,
        each,
        StreamOptions(queue=200),
        control,
    )
    lines = [line for line in moved(fake) if not line.endswith(",3" + ",0" * 18)]
    slow = [line.startswith("COORDSPLINET:200,") for line in lines]
    before = slow.index(True)
    assert slow == [False] * before + [True] * (60 - before)
    assert ("override", {"factor": 0.5, "segments_sent": before}) in notes
    assert planned[-1] == pytest.approx(0.1 * before + 0.2 * (60 - before), abs=0.41)


def test_a_pause_waits_for_all_that_the_unit_holds_however_long_that_takes(mars: Mars, fake: Any) -> None:
    path, control = run(120), Control()
    told: list[float] = []

    def pause() -> None:
        control.pause()
        told.append(mars.clock.now())

    def stands(progress: Progress) -> bool:
        if control.standing:
            told.append(mars.clock.now())
        return control.standing

    script = Script((reaches(60), pause), (stands, control.go_on))
    assert stream(mars, path, script, StreamOptions(ahead_s=5.0, queue=100), control).path == path
    assert told[1] - told[0] > 4.0


@pytest.mark.parametrize("times", [3])
def test_pauses_may_follow_each_other(mars: Mars, fake: Any, times: int) -> None:
    control = Control()
    acts: list[Any] = []
    for k in range(times):
        acts += [(reaches(8 * (k + 1)), control.pause), (lambda p: control.standing, control.go_on)]
    assert stream(mars, run(60), Script(*acts), None, control).path == run(60)


def standing(
    mars: Mars, fake: Any, then: Callable[[], None], after: Callable[[Progress], bool]
) -> ExecutionStopped:
    """What ends a stream that stands in a pause when something happens, and is then asked to go on."""
    control = Control()
    script = Script(
        (reaches(10), control.pause),
        (lambda p: control.standing, then),
        (after, control.go_on),
    )
    with pytest.raises(ExecutionStopped) as stopped:
        stream(mars, run(60), script, None, control)
    assert len(moved(fake)) == stopped.value.data["segments_sent"] < 40
    assert moved_after_stop(fake) == []
    assert stopped.value.data["state"]["at_rest"] is True
    return stopped.value


def moved_after_stop(fake: Any) -> list[str]:
    return [line for line in fake.since("STOP:") if line.startswith("COORD") and ":" in line]


@pytest.mark.parametrize("bits", [0x10000, 0x20000, 0x8])
def test_a_fault_in_a_pause_stops(mars: Mars, fake: Any, bits: int) -> None:
    error = standing(mars, fake, lambda: setattr(fake, "status_bits", bits), lambda p: False)
    assert error.data["reason"] == "fault"


def test_an_arm_pushed_in_a_pause_does_not_go_on(mars: Mars, fake: Any) -> None:
    error = standing(mars, fake, lambda: fake.offset.__setitem__(1, 26), lambda p: False)
    assert error.data["reason"] == "displaced"
    assert "26 counts from where it should be" in str(error)


def test_an_arm_pushed_just_before_going_on_does_not_go_on(mars: Mars, fake: Any) -> None:
    """The samples of before it was asked to go on do not count."""
    error = standing(mars, fake, lambda: fake.offset.__setitem__(1, 2000), lambda p: True)
    assert error.data["reason"] == "displaced"


def test_an_arm_that_does_not_come_to_stand_in_a_pause_is_told(mars: Mars, fake: Any) -> None:
    control = Control()

    def drift(line: str) -> None:
        if not fake.queue:
            fake.offset[4] += 5

    fake.hooks["COORDAP"] = drift
    with pytest.raises(ExecutionStopped, match=r"does not settle|counts from where it should be"):
        stream(mars, run(60), Script((reaches(10), control.pause)), None, control)


def test_a_pause_ends_before_the_unit_would_release_the_arm(fake: Any, unit: Unit, clock: Clock) -> None:
    from dataclasses import replace

    control = Control()
    for mars in opened(fake, replace(unit, idle_release_s=70), clock):
        with pytest.raises(ExecutionStopped, match="about to release the arm") as stopped:
            stream(mars, run(60), Script((reaches(10), control.pause)), None, control)
        assert stopped.value.data["reason"] == "idle"


# -- abort


@pytest.mark.parametrize("ask", ["control", "SIGINT"])
@pytest.mark.parametrize("after_s", [0.05, 0.61, 0.617, 0.74, 0.87, 3.3])
def test_stop_is_at_the_wire_within_100_ms(
    mars: Mars, fake: Any, clock: SteppedClock, ask: str, after_s: float
) -> None:
    """Whenever it is asked for, behind no more bytes than may be on their way."""
    control = Control()
    asked: list[float] = []

    def do() -> None:
        asked.append(clock.now())
        if ask == "control":
            control.abort()
        else:
            os.kill(os.getpid(), signal.SIGINT)

    clock.call_after(after_s, do)
    with pytest.raises(ExecutionStopped) as stopped:
        stream(mars, run(60), None, None, control)
    assert stopped.value.data["reason"] == {"control": "aborted", "SIGINT": "interrupted"}[ask]
    assert stopped.value.data["state"]["at_rest"] is True
    assert moved_after_stop(fake) == []
    stop = fake.lines.index("STOP:")
    assert fake.times[stop] - asked[0] < 0.1
    carried_at = 0.0  # when a line of 19200 baud has carried all that was sent before STOP
    for at, data in fake.line.sent[: min(k for k, (_, d) in enumerate(fake.line.sent) if b"STOP" in d)]:
        carried_at = max(carried_at, at) + len(data) / BYTES_PER_SECOND
    assert (carried_at - asked[0]) * BYTES_PER_SECOND <= 64 + 32  # and the piece that was being written


def test_an_abort_while_the_arm_stands_in_a_pause(mars: Mars, fake: Any) -> None:
    control = Control()
    script = Script((reaches(10), control.pause), (lambda p: control.standing, control.abort))
    with pytest.raises(ExecutionStopped, match="aborted on request; the arm has stopped") as stopped:
        stream(mars, run(60), script, None, control)
    assert stopped.value.data["reason"] == "aborted"
    assert moved_after_stop(fake) == []


def test_nothing_is_streamed_after_an_abort(mars: Mars, fake: Any) -> None:
    control = Control()
    control.abort()
    with pytest.raises(ExecutionStopped, match="aborted"):
        stream(mars, run(5), None, None, control)
    assert moved(fake) == []


# -- override


@pytest.mark.parametrize("override", [0.7, 0.33, LEAST_OVERRIDE])
def test_an_override_stretches_time_and_keeps_the_path_to_the_count(
    mars: Mars, fake: Any, override: float
) -> None:
    path = run(20, 90)
    sent = stream(mars, path, control=Control(override))
    assert [s.coefficients for s in sent.path.segments] == [s.coefficients for s in path.segments]
    for line, segment in zip(moved(fake), sent.path.segments, strict=True):
        ms, order, *values = (int(v) for v in line.split(":")[1].split(","))
        assert 90 / override <= ms < 90 / override + 1
        assert (ms, order) == (segment.duration_ms, 3)
        assert tuple(tuple(values[i::3]) for i in range(3)) == segment.coefficients
    assert sent.end_counts == path.end
    assert sent.duration_s >= path.duration_s / override - 0.05  # this unit has a line as soon as it is sent
    assert sent.ahead_s <= max(1.5, 0.4 + 2 * max(s.duration_ms for s in sent.path.segments) / 1e3)


def test_an_override_of_one_is_the_path_itself(mars: Mars) -> None:
    assert stretched(run(5), 1.0) == run(5)


@pytest.mark.parametrize("seed", range(5))
def test_an_override_only_lowers(seed: int, unit: Unit) -> None:
    """Random smooth cubics: velocity by the factor, acceleration by its square, and vertices by the unit's rule."""
    rng = np.random.default_rng(seed)
    times = np.cumsum([0, *rng.integers(20, 140, 60)]) / 1e3
    w = rng.uniform(0.3, 1.2, 6)
    amplitude = (
        0.8
        * np.minimum(  # of sines that stay within the registers
            unit.limits().velocity / w, unit.limits().acceleration / w**2
        )
        * np.abs(unit.counts_per_rad)
    )
    at = np.rint(amplitude * np.sin(np.outer(times, w))).astype(int)
    slope = amplitude * w * np.cos(np.outer(times, w))
    segments = []
    for k, (a, b) in enumerate(pairwise(times)):
        v0, v1, d = np.rint(slope[k] * (b - a)), np.rint(slope[k + 1] * (b - a)), at[k + 1] - at[k]
        rows = (v0, 3 * d - 2 * v0 - v1, v0 + v1 - 2 * d)
        segments.append(Segment(round(1e3 * (b - a)), tuple(tuple(int(c) for c in row) for row in rows)))
    path = CountPath(tuple(int(c) for c in at[0]), tuple(segments))
    override = float(rng.uniform(0.05, 0.99))
    slow = stretched(path, override)
    step = 5e-3 * unit.limits().acceleration * np.abs(unit.counts_per_rad)  # COORDDISCONT:5
    for before, after in zip(path.segments, slow.segments, strict=True):
        for u in (0.0, 0.3, 1.0):
            assert (np.abs(after.derivative(u)) <= override * np.abs(before.derivative(u)) + 1e-9).all()
            assert (
                np.abs(after.derivative(u, 2)) <= override**2 * np.abs(before.derivative(u, 2)) + 1e-6
            ).all()
    for one, two in pairwise(slow.segments):
        assert (np.abs(one.derivative(1.0) - two.derivative(0.0)) <= step).all()


@pytest.mark.parametrize("factor", [0.0, 0.04, 1.01, -1.0, float("nan")])
def test_an_override_out_of_range_is_refused(factor: float) -> None:
    with pytest.raises(InputError, match=r"must be from 0\.05 to 1; an override only slows down"):
        Control().override = factor
    with pytest.raises(InputError, match="only slows down"):
        Control(factor)


def test_an_override_stays_below_its_ceiling() -> None:
    control = Control(ceiling=0.4)
    assert control.override == 0.4
    with pytest.raises(InputError, match=r"must be from 0.05 to 0.4"):
        control.override = 0.5
    for ceiling in (0.0, 1.2, float("nan")):
        with pytest.raises(InputError, match="must be above 0 and at most 1"):
            Control(ceiling=ceiling)
    assert Control(ceiling=0.02).override == 0.02


def test_a_lost_link_leaves_no_more_than_the_look_ahead_in_a_pause(mars: Mars, fake: Any) -> None:
    control = Control()
    script = Script((reaches(10), control.pause), (lambda p: control.standing, fake.unplug))
    with pytest.raises(ExecutionStopped, match="the link is lost") as stopped:
        stream(mars, run(60), script, StreamOptions(), control)
    assert stopped.value.data["ahead_s"] == 0.0
