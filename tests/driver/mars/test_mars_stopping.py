"""What ends a motion early, and what is told then: interrupts, errors, silence, lost ports, damaged answers."""

from __future__ import annotations

import os
import signal
from typing import Any

import pytest

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from driver.line.clock import Clock
from driver.mars.mars import Mars
from wire.soft_home import SOFT_HOME


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
            ExecutionStopped, match="move: interrupted; the arm has stopped and is still under power"
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
