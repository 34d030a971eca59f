"""Pause, override and abort of an execution, between its steps and in them, at the wire of a scripted unit."""

from __future__ import annotations

from typing import Any

import pytest

from arm.controller.segments import CountPath, Segment
from arm.errors import ExecutionStopped
from arm.plan_file import GripperStep, LookStep, Move, Step
from driver.execution.control import Control
from driver.execution.execute import execute
from driver.execution.progress import Progress
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from wire.soft_home import SOFT_HOME


def line(name: str, start: tuple[int, ...], segments: int) -> Move:
    zero = (0,) * 6
    path = CountPath(start, (Segment(90, ((100, 20, -30, 5, 0, 0), zero, zero)),) * segments)
    return Move(name, "transit", 0, path, None, 0.05, 0.01, ("a", "b"))


def steps(*segments: int, settle_s: float = 0.2) -> list[Step]:
    """Motions with a gripper step behind each."""
    found: list[Step] = []
    at = SOFT_HOME
    for number, count in enumerate(segments):
        move = line(f"move {number}", at, count)
        at = move.path.end
        found += [move, GripperStep(f"close {number}", "close", 0, 1.0, settle_s)]
    return found


def test_a_pause_between_steps_waits_and_watches(mars: Mars, fake: Any, clock: SteppedClock) -> None:
    control, told = Control(), []
    control.tell = told.append
    began: list[float] = []

    def on_step(step: Step, index: int, total: int) -> None:
        began.append(clock.now())
        if index == 1:
            control.pause()  # while the jaws close, before the second motion
            clock.call_after(20.0, control.go_on)

    results = execute(mars, steps(5, 5), on_step, control=control)
    assert [r.step.name for r in results] == ["move 0", "close 0", "move 1", "close 1"]
    assert began[2] - began[1] > 15.0
    assert told == [
        "pausing",
        "paused: the arm has stopped and is still under power",
        "resuming: the arm moves again",
    ]
    between = [x for x, t in zip(fake.lines, fake.times, strict=False) if began[1] + 5 < t < began[2]]
    assert between.count("ST?") > 10
    assert {x.rstrip("?") for x in between} <= {"ST", "COORDAP", "APG"}


@pytest.mark.parametrize(
    ("harm", "reason"), [("status_bits", "fault"), ("offset", "displaced")], ids=["fault", "pushed"]
)
def test_what_happens_in_a_pause_between_steps_ends_it(
    mars: Mars, fake: Any, clock: SteppedClock, harm: str, reason: str
) -> None:
    control = Control()

    def on_step(step: Step, index: int, total: int) -> None:
        if index == 1:
            control.pause()
            value = 0x10000 if harm == "status_bits" else [0, 30, 0, 0, 0, 0]
            clock.call_after(20.0, lambda: setattr(fake, harm, value))

    with pytest.raises(ExecutionStopped, match=r"step 3 of 4 \(move 1\): pause") as stopped:
        execute(mars, steps(5, 5), on_step, control=control)
    assert stopped.value.data["reason"] == reason
    assert stopped.value.data["steps_done"] == 2
    assert stopped.value.data["state"]["at_rest"] is True
    assert not any(x.startswith("COORD") and ":" in x for x in fake.since("STOP:"))


def durations(fake: Any) -> list[int]:
    """Of all segments received, without the dwells."""
    rows = [x.split(":")[1].split(",") for x in fake.lines if x.startswith("COORDSPLINET")]
    return [int(row[0]) for row in rows if set(row[2:]) != {"0"}]


def test_the_override_holds_from_the_next_motion_on(mars: Mars, fake: Any) -> None:
    control = Control()
    seen: list[tuple[float, float]] = []

    def look(progress: Progress) -> None:
        seen.append((progress.override, progress.planned_s / max(progress.done, 1)))
        if progress.done > 3 and control.override == 1.0:
            control.override = 0.6

    plan = steps(8, 8)
    results = execute(mars, plan, None, look, control=control)
    assert durations(fake) == [90] * 8 + [150] * 8
    assert {o for o, _ in seen} == {1.0, 0.6}
    for override, each in seen:
        assert each in (0.0, pytest.approx({1.0: 0.09, 0.6: 0.15}[override]))
    for result, step in zip(results, plan, strict=True):
        if isinstance(step, Move):
            assert result.sent is not None
            assert [s.coefficients for s in result.sent.path.segments] == [
                s.coefficients for s in step.path.segments
            ]
            assert result.sent.end_counts == step.path.end


@pytest.mark.parametrize("step", ["move 1", "close 1", "settle"])
def test_an_abort_ends_any_step_with_stop_and_the_state(
    mars: Mars, fake: Any, clock: SteppedClock, step: str
) -> None:
    control = Control()

    def on_step(begun: Step, index: int, total: int) -> None:
        if begun.name == step or (step == "settle" and begun.name == "close 1"):
            clock.call_after(8.0 if step == "settle" else 0.4, control.abort)

    if step == "close 1":
        fake.hooks["RG"] = lambda x: [] if index_of(fake, "GG:103") > 1 else None
    plan = [*steps(5, 30, settle_s=30.0 if step == "settle" else 0.1), line("last", SOFT_HOME, 3)]
    plan[-1] = line("last", plan[2].path.end, 3)  # type: ignore[union-attr]
    with pytest.raises(ExecutionStopped, match="aborted on request") as stopped:
        execute(mars, plan, on_step, control=control)
    assert stopped.value.data["reason"] == "aborted"
    assert stopped.value.data["steps_done"] == {"move 1": 2, "close 1": 3, "settle": 3}[step]
    assert stopped.value.data["state"]["at_rest"] is True
    assert not any(x.startswith(("COORDS", "G")) for x in fake.since("STOP:"))
    assert clock.now() - fake.times[fake.lines.index("STOP:")] < 1.0


def index_of(fake: Any, text: str) -> int:
    return fake.lines.count(text)


def test_an_abort_before_it_begins_moves_nothing(mars: Mars, fake: Any) -> None:
    control = Control()
    control.abort()
    with pytest.raises(ExecutionStopped, match="aborted"):
        execute(mars, [LookStep("look"), *steps(3)], control=control)
    assert durations(fake) == []
