"""At rest is what was seen to stand and to be idle: a row a rule, at the wire of a scripted unit in stepped time."""

from __future__ import annotations

import os
import signal
from typing import Any

import pytest

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from driver.execution.rest import SAMPLE_S
from driver.line.clock import Clock
from driver.line.link import ANSWER_S
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.stopping import (
    STOP_S,
    UNECHOED_POLLS,
    bring_to_rest,
    group_is_gone,
    read_status,
)
from wire.soft_home import SOFT_HOME

BRAKES_S = 1.3  # the arm goes on for so long after STOP
AXES = tuple("ABCDEF")


def slides(fake: Any, counts_per_s: float, axis: int = 2) -> None:
    """From STOP on that axis moves for BRAKES_S, though nothing generates motion."""
    begun: list[float] = []

    def stop(line: str) -> None:
        begun.append(fake.clock.now())

    def at(line: str) -> None:
        if begun:
            passed = min(fake.clock.now() - begun[0], BRAKES_S)
            fake.offset[axis] = round(counts_per_s * passed)

    fake.hooks["STOP"], fake.hooks["COORDAP"] = stop, at


def stays_busy(fake: Any, bits: int = 0x10, for_s: float = BRAKES_S) -> None:
    """From STOP on the status has these bits for so long; the counts stand."""
    fake.hooks["STOP"] = lambda line: (
        setattr(fake, "status_bits", bits),
        fake.clock.call_after(for_s, lambda: setattr(fake, "status_bits", 0)),
        None,
    )[-1]


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("counts_per_s", [4000.0, -45.0])
def test_an_arm_whose_counts_change_is_not_at_rest(
    mars: Mars, fake: Any, clock: SteppedClock, axis: int, counts_per_s: float
) -> None:
    slides(fake, counts_per_s, axis)
    begin = clock.now()
    state = mars.stop()
    assert state.at_rest
    assert clock.now() - begin >= BRAKES_S
    assert state.counts == mars.counts()
    assert state.counts[axis] == fake.counts[axis] + round(counts_per_s * BRAKES_S)


def test_a_unit_that_is_busy_is_not_at_rest_though_its_counts_stand(
    mars: Mars, fake: Any, clock: SteppedClock
) -> None:
    stays_busy(fake)
    begin = clock.now()
    state = mars.stop()
    assert state.at_rest
    assert clock.now() - begin >= BRAKES_S
    assert state.status is not None
    assert not state.status.busy


@pytest.mark.parametrize("axes", [(), AXES])
def test_before_the_group_is_formed_the_status_tells(
    mars: Mars, fake: Any, clock: SteppedClock, axes: tuple[str, ...]
) -> None:
    stays_busy(fake)
    begin = clock.now()
    assert bring_to_rest(mars.link, axes).at_rest
    assert clock.now() - begin >= BRAKES_S


@pytest.mark.parametrize("what", ["counts", "busy"])
def test_what_never_ends_is_told_as_not_at_rest(
    mars: Mars, fake: Any, clock: SteppedClock, what: str
) -> None:
    if what == "busy":
        stays_busy(fake, for_s=1e6)
    else:
        fake.hooks["COORDAP"] = lambda line: fake.offset.__setitem__(0, fake.offset[0] + 50)
    begin = clock.now()
    state = mars.stop()
    assert not state.at_rest
    assert "still moving or busy 10 s after STOP" in state.note
    assert 10.0 <= clock.now() - begin < 11.0
    assert "MAY STILL BE MOVING" in state.describe(mars.unit)


@pytest.mark.parametrize("bits", [0x8, 0x10000, 0x20000])
def test_a_fault_holds_the_arm_whatever_the_unit_still_generates(
    mars: Mars, fake: Any, clock: SteppedClock, bits: int
) -> None:
    stays_busy(fake, bits | 0x10, 1e6)
    begin = clock.now()
    state = mars.stop()
    assert state.at_rest
    assert clock.now() - begin < 1.0
    assert state.status is not None
    assert state.status.fault


def test_a_fault_does_not_make_moving_counts_stand(mars: Mars, fake: Any, clock: SteppedClock) -> None:
    slides(fake, 4000.0)
    fake.status_bits = 0x10000
    begin = clock.now()
    assert mars.stop().at_rest
    assert clock.now() - begin >= BRAKES_S


def test_standing_is_two_samples_apart_and_not_one(mars: Mars, clock: SteppedClock) -> None:
    begin = clock.now()
    assert mars.stop().at_rest
    assert clock.now() - begin >= 0.099


def test_a_damaged_sample_is_not_one_of_the_two(mars: Mars, fake: Any, clock: SteppedClock) -> None:
    """The arm moves between the two that are sound: what lies between is nothing to compare with."""
    asked: list[float] = []

    def damaged(line: str) -> list[str] | None:
        asked.append(fake.clock.now())
        if len(asked) == 2:
            fake.offset[0] += 500
        if len(asked) in (2, 3):
            return ["COORDAP=1,2,x"]
        return None

    fake.hooks["COORDAP"] = damaged
    state = mars.stop()
    assert state.at_rest
    assert state.counts is not None
    assert state.counts[0] == fake.counts[0] + 500
    assert len(asked) >= 3


def test_a_link_that_is_lost_leaves_the_state_unknown(mars: Mars, fake: Any) -> None:
    fake.hooks["STOP"] = lambda line: fake.unplug()
    state = mars.stop()
    assert not state.at_rest
    assert "the link is lost" in state.note


@pytest.mark.parametrize("lost_s", [0.5, 1.0])
def test_an_arm_that_stands_before_stop_has_come_back_is_not_at_rest_yet(
    mars: Mars, fake: Any, clock: SteppedClock, lost_s: float
) -> None:
    """A STOP that is lost on the line leaves what the unit still holds: it stands in a dwell, and goes on after it."""
    begin, write = clock.now(), fake.write
    fake.write = lambda data: write(data.replace(b"STOP:\n", b"") if clock.now() < begin + lost_s else data)
    state = mars.stop()
    assert state.at_rest
    assert clock.now() - begin >= lost_s


def test_an_arm_that_stands_for_many_looks_is_at_rest_though_no_stop_comes_back(
    mars: Mars, fake: Any, clock: SteppedClock
) -> None:
    write = fake.write
    fake.write = lambda data: write(data.replace(b"STOP:\n", b""))
    begin = clock.now()
    assert mars.stop().at_rest
    assert UNECHOED_POLLS * SAMPLE_S <= clock.now() - begin < STOP_S


@pytest.mark.parametrize("axes", [("A",), AXES])
def test_a_group_that_is_gone_is_asked_for_axis_by_axis_however_many_there_are(
    mars: Mars, fake: Any, axes: tuple[str, ...]
) -> None:
    fake.hooks["COORDAP"] = lambda line: []
    fake.counts = [100 * (k + 1) for k in range(6)]
    state = bring_to_rest(mars.link, axes)
    assert state.at_rest
    assert state.counts == tuple(fake.counts[: len(axes)])


@pytest.mark.parametrize("hangs_s", [0.5, 1.9, 2.02, 2.5, 3.9])
def test_however_long_a_unit_hangs_the_answer_to_the_last_question_is_told(
    mars: Mars, fake: Any, clock: SteppedClock, hangs_s: float
) -> None:
    """It then answers all that it was asked, in order; the first answer must not pass for that to the second."""
    held: list[str] = []
    asked: list[str] = []
    until = clock.now() + hangs_s

    def when_awake(answer: str) -> list[str]:
        if clock.now() >= until:
            return [answer]
        held.append(answer)
        return []

    def status(line: str) -> list[str]:
        asked.append(line)
        return when_awake("ST=64" if len(asked) == 1 else "ST=32")

    fake.hooks["ST"] = status
    fake.hooks["STAMP"] = lambda line: when_awake(line.replace(":", "="))
    clock.call_after(hangs_s, lambda: [fake.write(f"{answer}\r\n".encode()) for answer in held])
    assert read_status(mars.link).word == (64 if hangs_s < ANSWER_S else 32)
    assert read_status(mars.link).word == 32


def test_axes_are_asked_one_by_one_only_where_the_group_does_not_answer(mars: Mars, fake: Any) -> None:
    fake.lines.clear()
    assert mars.stop().at_rest
    assert not any(line.startswith("AP") for line in fake.lines)


def test_a_stop_that_is_interrupted_again_does_not_say_that_the_arm_stands(
    mars: Mars, fake: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(mars.link, "receive", pressed)
    state = bring_to_rest(mars.link, AXES)
    assert not state.at_rest
    assert state.note == "interrupted again after STOP was sent"
    assert "STOP:" in fake.lines or state.stops > 0


@pytest.mark.parametrize("sign", ["no group", "clock"])
def test_a_unit_that_forgets_its_group_or_its_time_was_switched_off_and_on(
    mars: Mars, fake: Any, sign: str
) -> None:
    def anew(line: str) -> list[str]:
        ms = (int(fake.clock.now() * 1e3) + 30_000) % 65536
        return [] if sign == "no group" else [f"COORDAP={ms},0,0," + ",".join(map(str, fake.at()))]

    fake.hooks["COORDAP"] = anew
    with pytest.raises(ExecutionStopped, match="switched off and on") as stopped:
        mars.move_to(SOFT_HOME)
    assert stopped.value.data["reason"] == "restarted"
    assert "lost its positions" in stopped.value.data["state"]["note"]
    assert "under power" not in str(stopped.value)


def test_a_stop_after_a_power_cycle_reports_neither_positions_nor_power(
    mars: Mars, fake: Any, unit: Unit
) -> None:
    fake.hooks["COORDAP"] = lambda line: []  # the group is gone; every axis answers alone
    state = mars.stop()
    assert state.at_rest is True
    assert mars.link.restarted
    assert state.describe(unit) == "the arm has stopped, the unit has lost its positions: home it again"


def test_a_stop_that_misses_one_answer_for_the_group_reports_positions_and_power(
    mars: Mars, fake: Any, unit: Unit
) -> None:
    answers = iter([[]])
    fake.hooks["COORDAP"] = lambda line: next(answers, None)
    state = mars.stop()
    assert not mars.link.restarted
    assert state.describe(unit).startswith("the arm has stopped and is still under power, at [")


def test_one_lost_answer_does_not_prove_that_the_group_is_gone(mars: Mars, fake: Any) -> None:
    answers = iter([[]])
    fake.hooks["COORDAP"] = lambda line: next(answers, None)
    assert not group_is_gone(mars.link)
    fake.hooks["COORDAP"] = lambda line: []
    assert group_is_gone(mars.link)


def test_an_interrupt_is_a_stop_within_a_tenth_of_a_second(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.counts = list(SOFT_HOME)
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        mars.initialise(home=False)
        at: list[float] = []

        def interrupt(line: str) -> list[str]:
            fake.append(60.0, [c + 60_000 for c in SOFT_HOME])
            at.append(clock.now())
            os.kill(os.getpid(), signal.SIGINT)
            return []

        fake.hooks["COORDMV"] = interrupt
        with pytest.raises(
            ExecutionStopped, match="move interrupted; the arm has stopped and is still under power"
        ) as stopped:
            mars.move_to([c + 6000 for c in SOFT_HOME])
    assert stopped.value.data["reason"] == "interrupted"
    assert stopped.value.data["state"]["at_rest"] is True
    index = next(
        i for i, line in enumerate(fake.lines) if line == "STOP:" and fake.times[i] >= at[0]
    )  # again 50 ms later, until it has come back
    assert fake.times[index] - at[0] < 0.1
    assert not any(line.startswith("RELEASE") for line in fake.lines)
    assert not any(line.startswith("COORDMV") for line in fake.lines[index:])


def test_an_error_of_the_caller_stops_the_arm(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.counts = list(SOFT_HOME)

    def use() -> None:
        with Mars(fake.line, unit, clock) as mars:
            mars.identify()
            mars.initialise(home=False)
            fake.lines.clear()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        use()
    assert fake.lines[:2] == ["", "STOP:"]


def test_leaving_without_error_sends_nothing(fake: Any, unit: Unit, clock: Clock) -> None:
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        fake.lines.clear()
    clock.sleep(0.5)
    assert fake.lines == []


def test_a_silent_unit_is_stopped_and_its_state_told_unknown(mars: Mars, fake: Any) -> None:
    def fall_silent(line: str) -> list[str]:
        fake.mute = True
        return []

    fake.hooks["COORDMV"] = fall_silent
    with pytest.raises(ExecutionStopped, match=r"MAY STILL BE MOVING \(.*no answer") as stopped:
        mars.move_to(SOFT_HOME)
    assert stopped.value.data["state"]["at_rest"] is False
    assert "STOP:" in fake.since(next(line for line in fake.lines if line.startswith("COORDMV")))


def test_a_lost_port_is_told(mars: Mars, fake: Any) -> None:
    fake.unplug()
    with pytest.raises(ExecutionStopped, match="the link is lost") as stopped:
        mars.move_to(SOFT_HOME)
    assert stopped.value.data["state"]["at_rest"] is False
    assert stopped.value.data["reason"] == "link"


def test_a_damaged_answer_while_stopping_is_asked_again(mars: Mars, fake: Any) -> None:
    answers = iter([["ST=1x"], ["ST="], ["ST=9999999"]])  # twice in one question, then once more
    fake.hooks["ST"] = lambda line: next(answers, None) if line == "ST?" else None
    assert mars.stop().at_rest is True


def test_a_lost_answer_is_asked_again_once(mars: Mars, fake: Any) -> None:
    answers = iter([[], None, ["T=0"], ["ST=x"]])
    fake.hooks["ST"] = lambda line: next(answers, None) if line == "ST?" else None
    assert not mars.status().busy
    with pytest.raises(ExecutionStopped, match="'x' is not a whole number"):
        mars.status()


def test_a_late_answer_is_not_taken_for_the_next(mars: Mars, fake: Any) -> None:
    """The first question is answered only when it is asked again: the stale value must not be believed twice."""
    asked: list[str] = []

    def late(line: str) -> list[str]:
        asked.append(line)
        return [[], ["ST=16", "ST=0"], ["ST=32"]][min(len(asked), 3) - 1]

    fake.hooks["ST"] = late
    mars.status()
    mars.link.synchronise()
    assert mars.status().word == 32
