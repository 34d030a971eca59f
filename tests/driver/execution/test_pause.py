"""A pause of a stream, at the wire of a scripted unit: the arm stops on its path, and moves on only from there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from driver.execution.control import Control
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.line.clock import Clock
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from wire.controlled_stream import Script, moved, moved_after_stop, opened, reaches, run


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


def test_a_lost_link_leaves_no_more_than_the_look_ahead_in_a_pause(mars: Mars, fake: Any) -> None:
    control = Control()
    script = Script((reaches(10), control.pause), (lambda p: control.standing, fake.unplug))
    with pytest.raises(ExecutionStopped, match="the link is lost") as stopped:
        stream(mars, run(60), script, StreamOptions(), control)
    assert stopped.value.data["ahead_s"] == 0.0
