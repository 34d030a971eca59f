"""The emulated unit's lines without a line: what it answers, what it ignores, when it is ready."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import load_unit
from driver.emulator.commands import Interpreter
from driver.emulator.options import EmulatorOptions
from driver.emulator.unit.machine import Machine

UNIT = load_unit("crs93")


def made(options: EmulatorOptions | None = None) -> Interpreter:
    return Interpreter(Machine(UNIT, None, options or EmulatorOptions()))


def grouped(options: EmulatorOptions | None = None) -> Interpreter:
    unit = made(options)
    unit.take("COORDGRP:A,B,C,D,E,F")
    return unit


def finish(unit: Interpreter, most_ms: int = 120_000) -> list[str]:
    """Run until idle; what was answered on the way."""
    answers = []
    for _ in range(most_ms):
        if not unit.machine.busy:
            break
        unit.machine.run(1)
        answers += unit.ready()
    assert not unit.machine.busy
    return answers


def test_identity_and_order() -> None:
    unit = made()
    assert unit.take("VER?") == ["VER=MARS8 v1.0 build Pi Oct  2 2017 11:06:45"]
    assert unit.take("STAMP:32767\r") == ["STAMP=32767"]
    assert unit.take("") == unit.take("\r") == []
    assert unit.echo
    unit.take("ECHO:0")
    assert not unit.echo


@pytest.mark.parametrize(
    "line",
    ["COORDISCONT:5", "REGMS:A:7680", "FOO:1", "nonsense", "STAMP:", "STAMP:x", "COORDMV:1,2", "GA:", "HH:",
     "COORDSPLINET:100,2,1,2,3", "COORDSPLINET:100,-1,0,0", "REGMSA:nan", "REGMSA:inf", "\xff\x80", "COORDGRP:A,A",
     "STAMP:99999", "help", "REGMSA:0", "RELEASEZ:", "APZ?", "ST:", "R:1"],
)  # fmt: skip
def test_what_is_not_understood_is_silent_and_changes_nothing(line: str) -> None:
    unit = grouped()
    assert unit.take(line) == []
    assert unit.machine.status() == 0
    assert unit.machine.registers["REGMSA"] == UNIT.speed_registers[0]
    assert len(unit.machine.group) == 6
    assert unit.ignored
    assert grouped(EmulatorOptions(unknown="fail")).take(line) == ["FAIL!"]


def test_decimals_are_taken_where_whole_numbers_are_meant() -> None:
    unit = made()
    unit.take("REGMSA:5000.0")
    unit.take("REGACCA:51.0")
    unit.take("GG:471.5")
    assert not unit.ignored
    assert unit.machine.registers["REGMSA"] == 5000


def test_ready_waits_and_several_may_be_outstanding() -> None:
    unit = made()
    assert unit.take("R:") == ["R!"]
    unit.take("GA:1000")
    unit.take("GB:200")
    assert unit.take("RA:") == unit.take("RB:") == unit.take("R:") == []
    assert unit.take("RC:") == ["RC!"]
    assert int(unit.take("ST?")[0][3:]) == 0x10
    answers = finish(unit)
    assert sorted(answers) == ["R!", "RA!", "RB!"]
    assert unit.take("APA?") == ["APA=1000"]
    assert unit.take("APA?:") == ["APA=1000"]
    assert unit.take("APB?") == ["APB=200"]


@pytest.mark.parametrize(("fault", "bit"), [("power", 0x10000), ("stop", 0x20000), ("axis", 0x8)])
def test_faults_fail_waits_and_stop_motion(fault: str, bit: int) -> None:
    unit = grouped()
    unit.take("COORDMV:1000,0,0,0,0,0")
    unit.take("R:")
    unit.machine.run(20)
    machine = unit.machine
    machine.power, machine.motion_stop = fault != "power", fault == "stop"
    machine.axis_errors = {"B"} if fault == "axis" else set()
    machine.freeze()
    assert unit.ready() == ["FAIL!"]
    assert unit.take("ST?") == [f"ST={bit}"]
    assert bit < 2**18
    before = machine.reference
    unit.take("COORDMV:0,0,0,0,0,0")
    machine.run(100)
    assert machine.reference == before
    unit.take("PURGE:")
    assert machine.faulty == (fault != "axis")


def test_homing_makes_the_mark_zero_and_the_truth_agrees() -> None:
    unit = grouped()
    stood = unit.machine.true_counts()
    assert stood == tuple(UNIT.counts(np.radians(EmulatorOptions().power_up_deg)))
    assert unit.take("APA?") == ["APA=0"]
    for group in UNIT.homing:
        for axis in group:
            unit.take(f"HH{axis}:")
        assert unit.take("R:") == []
        assert finish(unit) == ["R!"]
    assert unit.machine.true_counts() == (0,) * 6
    assert unit.take("COORDAP?")[0].split(",")[3:] == ["0"] * 6
    assert all(unit.machine.homed)


def test_a_stopped_homing_is_no_homing() -> None:
    unit = grouped()
    unit.take("HHA:")
    unit.machine.run(500)
    unit.take("STOP:")
    finish(unit)
    assert not unit.machine.homed[0]
    assert unit.machine.true_counts()[0] != 0


def test_coordap_has_time_number_place_and_the_group_in_its_order() -> None:
    unit = made()
    unit.take("COORDGRP:C,A")
    assert unit.take("COORDAP?") == ["COORDAP=0,0,0,0,0"]
    unit.take("COORDRELMVT:500,300,-700")
    unit.take("COORDRELMVT:500,0,-700")
    unit.machine.run(100)
    ms, number, place, c, a = map(int, unit.take("COORDAP?")[0][8:].split(","))
    assert (ms, number) == (100, 1)
    assert 0 < place < 65536
    assert 0 < c < 300
    assert -700 < a < 0
    finish(unit)
    *_, c, a = map(int, unit.take("COORDAP?")[0][8:].split(","))
    assert (c, a) == (300, -1400)
    unit.machine.now_ms += 65536
    assert int(unit.take("COORDAP?")[0][8:].split(",")[0]) < 65536


def test_the_queue_holds_200_and_tells_when_50_are_left() -> None:
    unit = grouped()
    bits = []
    for _ in range(200):
        assert unit.take("COORDRELMVT:100,10,0,0,0,0,0") == []
        bits.append(bool(int(unit.take("ST?")[0][3:]) & 0x80))
    assert bits.index(True) == 149  # the 150th leaves 50
    assert not unit.machine.violations
    unit.take("COORDRELMVT:100,10,0,0,0,0,0")
    assert "beyond" in unit.machine.violations[0].what
    finish(unit)
    assert unit.machine.reference[0] == 2000
    full = grouped(EmulatorOptions(overflow="fail", queue=1))
    full.take("COORDMV:1,0,0,0,0,0")
    assert full.take("COORDMV:2,0,0,0,0,0") == ["FAIL!"]


def test_spline_is_axis_major_and_starts_where_the_one_before_ends() -> None:
    unit = grouped()
    unit.take("COORDSPLINET:200,3,100,20,3,0,0,0,0,0,0,0,0,0,0,0,0,-5,-6,-7")
    unit.take("COORDSPLINET:200,2,1,1,2,2,0,0,0,0,0,0,0,0")
    finish(unit)
    assert unit.machine.reference == (125, 4, 0, 0, 0, -18)


def test_a_segment_after_stop_starts_where_the_arm_stopped() -> None:
    unit = grouped()
    unit.take("COORDMV:20000,0,0,0,0,0")
    unit.machine.run(300)
    unit.take("STOP:")
    unit.take("COORDRELMVT:100,0,50,0,0,0,0")
    finish(unit)
    a, b, *_ = unit.machine.reference
    assert 0 < a < 20000
    assert b == 50


def test_purge_then_stop_when_idle_leaves_it_idle() -> None:
    unit = made()
    unit.take("PURGE:")
    unit.take("STOP:")
    assert unit.take("ST?") == ["ST=0"]


def test_engaging_the_shoulder_takes_its_time_and_moves_nothing() -> None:
    unit = made()
    unit.take("SPDTB:0,300")
    unit.take("RB:")
    begin = unit.machine.now_ms
    assert finish(unit) == ["RB!"]
    assert unit.machine.now_ms - begin in (300, 301)
    assert unit.take("APB?") == ["APB=0"]


@pytest.mark.parametrize(("target", "end"), [(103, 103), (-800, 103), (500, 500), (2000, 840)])
def test_the_gripper_keeps_inside_its_stroke(target: int, end: int) -> None:
    unit = made()
    unit.take("GG:300")
    finish(unit)
    unit.take("RELEASEG:")
    unit.take(f"GG:{target}")
    finish(unit)
    assert unit.take("APG?") == [f"APG={end}"]


def test_leaving_the_limits_is_noted_and_not_prevented() -> None:
    unit = grouped()
    for axis in "ABCDEF":
        unit.take(f"HH{axis}:")
    finish(unit)
    unit.machine.violations.clear()
    unit.take("COORDMV:0,200000,0,0,0,0")
    finish(unit)
    assert unit.machine.reference[1] == 200000
    assert len(unit.machine.violations) == 1
    assert "axis B" in unit.machine.violations[0].what


def test_registers_may_be_readable() -> None:
    unit = made(EmulatorOptions(registers_readable=True))
    assert unit.take("REGMSA?") == ["REGMSA=7680"]
    assert unit.take("COORDDISCONT?") == ["COORDDISCONT=1"]
    assert made().take("REGMSA?") == []


def test_the_public_client_s_opening_is_understood_but_for_its_misspelling() -> None:
    """The order of lines of ctu_crs 1.0.6 (fact sheet, section 4.3, wire log)."""
    unit = made()
    opening = ["", "ECHO:0", "STAMP:1", "VER?", "STAMP:2", "PURGE:", "STOP:", "ST?", "R:"]
    opening += [f"{name}{axis}:{value}" for name, value in (("REGME", 32000), ("REGCFG", 1489), ("REGP", 10),
                ("REGI", 80), ("REGD", 20)) for axis in "ABCDEF"]  # fmt: skip
    opening += [f"REGMS{axis}:7680.0" for axis in "ABCDEF"] + [f"REGACC{axis}:51.0" for axis in "ABCDEF"]
    opening += ["IDLEREL:1200", "ANAXSETUPG:10,16", "REGS1G:16", "REGS2G:500", "REGMEG:10000", "REGMSG:500"]
    opening += ["REGCFGG:256", "REGPG:200", "REGIG:0", "REGDG:100", "SPDTB:0,300", "R:"]
    answers = [text for line in opening for text in unit.take(line)]
    assert answers == ["STAMP=1", "VER=" + EmulatorOptions().version, "STAMP=2", "ST=0", "R!"]
    assert finish(unit) == ["R!"]
    for line in ("COORDGRP:A,B,C,D,E,F", "COORDISCONT:5", "COORDMV:100,0,0,0,0,0", "", "R:"):
        assert unit.take(line) == []
    assert finish(unit) == ["R!"]
    assert [text for _, text in unit.ignored] == ["COORDISCONT:5"]
    assert not unit.machine.violations
