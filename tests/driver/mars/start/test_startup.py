"""What a unit is told when it is taken into use."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from driver.line.clock import Clock
from driver.mars.mars import Mars
from driver.mars.start.startup import limit_lines, move_time, slow_registers
from wire.soft_home import SOFT_HOME


@pytest.mark.parametrize("name", ["crs93", "crs97"])
def test_a_careful_move_is_five_times_slower_and_never_stands(name: str) -> None:
    unit = load_unit(name)
    slow = slow_registers(unit)
    assert [5 * r for r in slow] == pytest.approx(unit.speed_registers, abs=2.5)
    assert slow_registers(replace(unit, speed_registers=(1, 2, 3, 7, 8, 10))) == (1, 1, 1, 1, 2, 2)


def test_initialise_homes_in_the_units_order_and_goes_to_soft_home(mars: Mars, fake: Any) -> None:
    told = [line for line in fake.lines if line.startswith(("HH", "R:", "COORDMV"))]
    homing = told[told.index("HHB:") :]
    # the fake's axes stand at their marks, so none is seen to move, and each is homed once more
    groups = (["HHB:", "R:"], ["HHA:", "HHC:", "R:"], ["HHD:", "HHE:", "HHF:", "R:"])
    assert homing[:18] == [line for group in groups for line in group * 2]
    marks = "COORDMV:0,0,0,0,0,0"  # slowly, where it stands: from there on a move can be verified before it begins
    assert homing[18:] == [marks, "R:", "COORDMV:" + ",".join(str(c) for c in SOFT_HOME), "R:"]
    assert tuple(mars.counts()) == SOFT_HOME
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
    fake.counts = list(SOFT_HOME)
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        mars.initialise(home=False)
        assert mars.reference is None  # where the unit's generator stands is not known
    assert not any(line.startswith(("HH", "COORDMV", "COORDSPLINET")) for line in fake.lines)


def test_a_unit_fresh_from_power_up_must_be_homed(fake: Any, unit: Unit, clock: Clock) -> None:
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ImpossibleError, match="must be homed"):
            mars.initialise(home=False)


@pytest.mark.parametrize(
    ("bits", "said"), [(0x10000, "arm power is off"), (0x20000, "motion stop"), (0x8, "an axis is in error")]
)
def test_faults_before_homing_are_refused(fake: Any, unit: Unit, clock: Clock, bits: int, said: str) -> None:
    fake.status_bits = bits
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ImpossibleError, match=f"{said}.*press Motion Stop, then Arm Power"):
            mars.initialise()
    assert not any(line.startswith("HH") for line in fake.lines)


def test_a_failed_homing_stops_and_tells_the_state(fake: Any, unit: Unit, clock: Clock) -> None:
    def fail(line: str) -> list[str]:
        fake.status_bits = 0x8
        return []

    fake.hooks["HHC"] = fail
    with Mars(fake.line, unit, clock) as mars:
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
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ExecutionStopped, match="axis B reads 5000 counts at its mark"):
            mars.initialise()


def test_a_register_that_reads_back_otherwise_is_an_error(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.hooks["REGMSB"] = lambda line: ["REGMSB=9999"] if line.endswith("?") else None
    fake.hooks["REGMSA"] = lambda line: ["REGMSA=7680"] if line.endswith("?") else None
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        with pytest.raises(ExecutionStopped, match="REGMSB reads 9999 after 2048"):
            mars.initialise()


def test_registers_are_capped_by_the_unit(mars: Mars, fake: Any, unit: Unit) -> None:
    before = len(fake.lines)
    over = (*unit.speed_registers[:5], 24564)  # 171 deg/s of the data sheet is 24563
    with pytest.raises(InputError, match="speed register of axis F = 24564"):
        mars.set_registers(over, unit.acceleration_registers)
    assert len(fake.lines) == before
    mars.set_registers((*unit.speed_registers[:5], 24563), unit.acceleration_registers)
    mars.link.synchronise()
    assert "REGMSF:24563" in fake.lines


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


def test_where_the_arm_is_cannot_be_asked_before_the_group_is_formed(
    fake: Any, unit: Unit, clock: Clock
) -> None:
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        fake.lines.clear()
        for ask in (mars.position, mars.counts):
            with pytest.raises(InputError, match=r"position: call initialise\(\) first"):
                ask()
        assert fake.lines == []
