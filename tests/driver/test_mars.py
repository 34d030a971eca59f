"""The driver against a scripted unit: what is sent, in which order, and what every failure leaves behind."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.unit import Unit, load_unit
from driver.clock import Clock
from driver.mars import Mars
from driver.startup import limit_lines, move_time, slow_registers

HOME = [-181650, -349, -12200, 99200, 33300, -96500]  # the fact sheet's soft home of crs93


@pytest.fixture
def mars(fake: Any, unit: Unit, clock: Clock) -> Any:
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        mars.initialise()
        yield mars


# -- identity


@pytest.mark.parametrize("version", ["LX_ROCON v2", "MARS81 x", "", "mars8"])
def test_another_controller_is_refused_untouched(fake: Any, unit: Unit, clock: Clock, version: str) -> None:
    fake.hooks["VER"] = lambda line: [f"VER={version}"]
    with Mars(fake.url, unit, clock) as mars, pytest.raises(InputError, match="is not MARS8"):
        mars.identify()
    assert {line.split(":")[0] for line in fake.lines} <= {"", "ECHO", "STAMP", "VER?"}


def test_something_that_only_echoes_is_refused(fake: Any, unit: Unit, clock: Clock) -> None:
    for name in ("STAMP", "VER", "ECHO"):
        fake.hooks[name] = lambda line: [line]
    with Mars(fake.url, unit, clock) as mars, pytest.raises(InputError, match="does not answer like a MARS8"):
        mars.identify()
    assert {line.split(":")[0] for line in fake.lines} <= {"", "ECHO", "STAMP"}


def test_power_up_noise_does_not_hide_the_unit(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.echo = False  # an echoed line end would separate the noise from the answer
    fake.write(b"\xff\x00\x80MARS")  # half a line of noise that spoils the first answer
    with Mars(fake.url, unit, clock) as mars:
        assert mars.identify().startswith("MARS8 v1.0")


def test_nothing_moves_before_identify(fake: Any, unit: Unit, clock: Clock) -> None:
    with Mars(fake.url, unit, clock) as mars, pytest.raises(InputError, match=r"identify\(\) comes before"):
        mars.initialise()
    assert fake.lines == []


def test_a_unit_that_echoes_again_was_switched_off_and_on(mars: Mars, fake: Any) -> None:
    fake.echo = True
    with pytest.raises(ExecutionStopped, match="switched off and on") as stopped:
        mars.move_to(HOME)
    assert stopped.value.data["reason"] == "restarted"
    assert "lost its positions" in stopped.value.data["state"]["note"]


# -- taking into use


def test_initialise_homes_in_the_units_order_and_goes_to_soft_home(mars: Mars, fake: Any) -> None:
    told = [line for line in fake.lines if line.startswith(("HH", "R:", "COORDMV"))]
    homing = told[told.index("HHB:") :]
    # the fake's axes stand at their marks, so none is seen to move, and each is homed once more
    groups = (["HHB:", "R:"], ["HHA:", "HHC:", "R:"], ["HHD:", "HHE:", "HHF:", "R:"])
    assert homing[:18] == [line for group in groups for line in group * 2]
    assert homing[18:] == ["COORDMV:" + ",".join(str(c) for c in HOME), "R:"]
    assert list(mars.counts()) == HOME
    for line in (
        "REGMSA:7680",
        "REGACCF:768",
        "REGCFGA:1489",
        "IDLEREL:1200",
        "ANAXSETUPG:10,16",
        "REGS2G:500",
    ):
        assert line in fake.lines
    assert fake.lines.count("COORDGRP:A,B,C,D,E,F") >= 1
    assert "COORDDISCONT:5" in fake.lines
    assert not any("." in line for line in fake.lines)
    assert fake.since("PURGE:")[0].startswith("STAMP:")  # parsed before a stop that drops what is on its way
    assert not any(line.startswith("RELEASE") for line in fake.lines)


def test_initialise_without_homing_moves_nothing(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.counts = list(HOME)
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        mars.initialise(home=False)
        assert mars.reference is None  # where the unit's generator stands is not known
    assert not any(line.startswith(("HH", "COORDMV", "COORDSPLINET")) for line in fake.lines)


def test_a_unit_fresh_from_power_up_must_be_homed(fake: Any, unit: Unit, clock: Clock) -> None:
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ImpossibleError, match="must be homed"):
            mars.initialise(home=False)


@pytest.mark.parametrize(
    ("bits", "said"), [(0x10000, "arm power is off"), (0x20000, "motion stop"), (0x8, "an axis is in error")]
)
def test_faults_before_homing_are_refused(fake: Any, unit: Unit, clock: Clock, bits: int, said: str) -> None:
    fake.status_bits = bits
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ImpossibleError, match=f"{said}.*press Motion Stop, then Arm Power"):
            mars.initialise()
    assert not any(line.startswith("HH") for line in fake.lines)


def test_a_failed_homing_stops_and_tells_the_state(fake: Any, unit: Unit, clock: Clock) -> None:
    def fail(line: str) -> list[str]:
        fake.status_bits = 0x8
        return []

    fake.hooks["HHC"] = fail
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ExecutionStopped, match="homing: axes A, C: an axis is in error") as stopped:
            mars.initialise()
    state = stopped.value.data["state"]
    assert state["at_rest"] is True
    assert state["faults"] == ["an axis is in error"]
    assert state["counts"] == [0] * 6
    assert "STOP:" in fake.since("HHC:")
    assert "HHD:" not in fake.lines


def test_a_mark_that_was_not_found_is_an_error(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.counts[1] = 5000
    fake.hooks["HHB"] = lambda line: []
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ExecutionStopped, match="axis B reads 5000 counts at its mark"):
            mars.initialise()


def test_a_register_that_reads_back_otherwise_is_an_error(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.hooks["REGMSB"] = lambda line: ["REGMSB=9999"] if line.endswith("?") else None
    fake.hooks["REGMSA"] = lambda line: ["REGMSA=7680"] if line.endswith("?") else None
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ExecutionStopped, match="REGMSB reads 9999 after 2048"):
            mars.initialise()


# -- moving


def test_registers_are_capped_by_the_unit(mars: Mars, fake: Any, unit: Unit) -> None:
    before = len(fake.lines)
    over = (*unit.speed_registers[:5], 24564)  # 171 deg/s of the data sheet is 24563
    with pytest.raises(InputError, match="speed register of axis F = 24564"):
        mars.set_registers(over, unit.acceleration_registers)
    assert len(fake.lines) == before
    mars.set_registers((*unit.speed_registers[:5], 24563), unit.acceleration_registers)
    mars.link.synchronise()
    assert "REGMSF:24563" in fake.lines


def test_move_to_goes_where_it_is_told(mars: Mars, fake: Any) -> None:
    target = [c + 1000 for c in HOME]
    assert list(mars.move_to(target)) == target
    assert mars.reference == tuple(target)


def test_a_target_outside_the_limits_moves_nothing(mars: Mars, fake: Any, unit: Unit) -> None:
    before = len(fake.lines)
    with pytest.raises(ImpossibleError, match=r"target 90\..* deg on axis B: must be from"):
        mars.move_to([HOME[0], 100_000, *HOME[2:]])
    assert len(fake.lines) == before


def test_an_old_ready_is_not_believed(mars: Mars, fake: Any, clock: Clock) -> None:
    """R! comes at once, left over from an abandoned wait; the arm only starts later, but the status says busy."""
    target = tuple(c + 1000 for c in HOME)
    asked = []

    def late(line: str) -> list[str] | None:
        asked.append(line)
        if len(asked) < 5:
            return ["ST=16"]
        fake.counts = list(target)
        return None

    def start(line: str) -> list[str]:
        fake.hooks["ST"] = late
        return []

    fake.hooks["COORDMV"] = start
    fake.hooks["R"] = lambda line: ["R!"]
    assert mars.move_to(target) == target


def test_a_static_error_of_the_arm_is_accepted_up_to_25_counts(mars: Mars, fake: Any) -> None:
    fake.offset = [25, -19, 3, 1, 2, 0]
    target = [c + 500 for c in HOME]
    assert mars.move_to(target)[0] == target[0] + 25
    fake.offset = [27, 0, 0, 0, 0, 0]
    with pytest.raises(ExecutionStopped, match="counts from") as stopped:
        mars.move_to(HOME)
    assert stopped.value.data["reason"] == "displaced"


def test_an_arm_that_was_pushed_is_not_moved(mars: Mars, fake: Any) -> None:
    fake.counts[0] += 4000
    with pytest.raises(ExecutionStopped, match="4000 counts from where the last motion ended") as stopped:
        mars.move_to(HOME)
    assert stopped.value.data["state"]["counts"][0] == HOME[0] + 4000
    assert len([line for line in fake.lines if line.startswith("COORDMV")]) == 1  # the soft home's


def test_an_arm_that_does_not_settle_is_stopped(mars: Mars, fake: Any) -> None:
    def drift(line: str) -> None:
        fake.offset[0] += 4

    fake.hooks["COORDAP"] = drift
    with pytest.raises(ExecutionStopped, match="does not settle") as stopped:
        mars.settled_counts()
    assert stopped.value.data["reason"] == "settle"


def test_after_a_stop_the_generator_is_anchored_slowly(mars: Mars, fake: Any, unit: Unit) -> None:
    fake.lines.clear()
    mars.stop()
    assert mars.reference is None
    mars.anchor(HOME)
    mars.link.synchronise()
    since = fake.since("STOP:")
    moves = [i for i, line in enumerate(since) if line.startswith("COORDMV")]
    assert len(moves) == 2
    slow = since.index(f"REGMSA:{slow_registers(unit)[0]}")
    assert slow < moves[0]
    assert since.index("REGMSA:7680") > moves[1]
    assert mars.reference == tuple(HOME)
    with pytest.raises(ImpossibleError, match="26 counts"):
        mars.anchor([HOME[0] + 26, *HOME[1:]])


def test_the_shoulder_is_engaged_again_after_idling(mars: Mars, fake: Any, monkeypatch: Any) -> None:
    mars._last_motion -= 1150.0
    mars.move_to(HOME)
    assert fake.lines.count("SPDTB:0,300") == 2


# -- gripper


def test_gripper_tells_an_object_from_none(mars: Mars, fake: Any) -> None:
    shut = mars.gripper(1.0)
    assert (shut.adc, shut.stalled) == (103, False)
    mars.gripper(0.0)
    fake.gripper_stop = 420
    held = mars.gripper(1.0)
    assert (held.adc, held.stalled) == (420, True)
    assert held.fraction_closed == pytest.approx((840 - 420) / 737)
    assert fake.lines[fake.lines.index("GG:103") - 1] == "RELEASEG:"
    with pytest.raises(InputError, match="must be from 0 to 1"):
        mars.gripper(1.01)


def test_gripper_failure_stops(mars: Mars, fake: Any) -> None:
    fake.hooks["RG"] = lambda line: ["FAIL!"]
    with pytest.raises(ExecutionStopped, match="gripper: the jaws: the unit answered FAIL!"):
        mars.gripper(1.0)
    assert "STOP:" in fake.since("RG:")


def test_jaws_that_never_rest_end_by_the_deadline(mars: Mars, fake: Any) -> None:
    fake.hooks["APG"] = lambda line: [f"APG={int(mars.clock.now() * 1000) % 700}"]
    with pytest.raises(ExecutionStopped, match="the jaws are not at rest within 10 s"):
        mars.gripper(1.0)


# -- stopping


def test_an_interrupt_is_a_stop_within_a_tenth_of_a_second(fake: Any, unit: Unit) -> None:
    clock = fake.clock = Clock(1.0)
    fake.counts = list(HOME)
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        mars.initialise(home=False)
        at: list[float] = []

        def interrupt(line: str) -> list[str]:
            fake.append(60.0, [c + 60_000 for c in HOME])
            at.append(clock.now())
            os.kill(os.getpid(), signal.SIGINT)
            return []

        fake.hooks["COORDMV"] = interrupt
        with pytest.raises(
            ExecutionStopped, match="move: interrupted; the arm stands still under power"
        ) as stopped:
            mars.move_to([c + 6000 for c in HOME])
    assert stopped.value.data["reason"] == "interrupted"
    assert stopped.value.data["state"]["at_rest"] is True
    index = max(i for i, line in enumerate(fake.lines) if line == "STOP:")
    assert fake.times[index] - at[0] < 0.1
    assert not any(line.startswith("RELEASE") for line in fake.lines)
    assert not any(line.startswith("COORDMV") for line in fake.lines[index:])


def test_an_error_of_the_caller_stops_the_arm(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.counts = list(HOME)

    def use() -> None:
        with Mars(fake.url, unit, clock) as mars:
            mars.identify()
            mars.initialise(home=False)
            fake.lines.clear()
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        use()
    assert fake.lines[:2] == ["", "STOP:"]


def test_leaving_without_error_sends_nothing(fake: Any, unit: Unit, clock: Clock) -> None:
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        fake.lines.clear()
    time.sleep(0.02)
    assert fake.lines == []


def test_a_silent_unit_is_stopped_and_its_state_told_unknown(mars: Mars, fake: Any) -> None:
    def fall_silent(line: str) -> list[str]:
        fake.mute = True
        return []

    fake.hooks["COORDMV"] = fall_silent
    with pytest.raises(ExecutionStopped, match=r"NOT known \(.*no answer to STAMP") as stopped:
        mars.move_to(HOME)
    assert stopped.value.data["state"]["at_rest"] is False
    assert "STOP:" in fake.since(next(line for line in fake.lines if line.startswith("COORDMV")))


def test_a_lost_port_is_told(mars: Mars, fake: Any) -> None:
    fake.unplug()
    with pytest.raises(ExecutionStopped, match="the link is lost") as stopped:
        mars.move_to(HOME)
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


# -- arithmetic


def test_move_time_is_the_trapezoid() -> None:
    unit = load_unit("crs93")
    # axis A: 30 counts/ms reached in 150.6 ms; 60000 counts at speed
    distance = (60_000, 0, 0, 0, 0, 0)
    expected = 60_000 / 30.0 / 1e3 + 30.0 / (51 / 256) / 1e3
    assert move_time(distance, unit.speed_registers, unit.acceleration_registers) == pytest.approx(expected)
    short = 2.0 * (100 / (51 / 256)) ** 0.5 / 1e3
    assert move_time(
        (-100, 0, 0, 0, 0, 0), unit.speed_registers, unit.acceleration_registers
    ) == pytest.approx(short)
    assert move_time((0,) * 6, unit.speed_registers, unit.acceleration_registers) == 0.0


def test_limit_lines_refuse_zero() -> None:
    unit = load_unit("crs97")
    with pytest.raises(InputError, match="acceleration register of axis B = 0"):
        limit_lines(unit, unit.speed_registers, (19, 0, 13, 19, 128, 154))


def test_the_driver_knows_no_kinematics(tmp_path: Path) -> None:
    import subprocess
    import sys

    code = (
        "import sys, driver.execute, driver.wirelog\n"
        "heavy = {'pinocchio', 'coal', 'arm.robot', 'cv2', 'toppra'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
