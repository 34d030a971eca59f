"""The emulated unit's lines without a line: what it answers, what it ignores, when it is ready."""

from __future__ import annotations

import pytest

from driver.emulator.options import EmulatorOptions
from emulated.lineless_unit import UNIT, finish, grouped, made


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
    before = machine.path.at
    unit.take("COORDMV:0,0,0,0,0,0")
    machine.run(100)
    assert machine.path.at == before
    unit.take("PURGE:")
    assert machine.faulty == (fault != "axis")


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


def test_spline_is_axis_major_and_starts_where_the_one_before_ends() -> None:
    unit = grouped()
    unit.take("COORDSPLINET:200,3,100,20,3,0,0,0,0,0,0,0,0,0,0,0,0,-5,-6,-7")
    unit.take("COORDSPLINET:200,2,1,1,2,2,0,0,0,0,0,0,0,0")
    finish(unit)
    assert unit.machine.path.at == (125, 4, 0, 0, 0, -18)


def test_registers_may_be_readable() -> None:
    unit = made(EmulatorOptions(registers_readable=True))
    assert unit.take("REGMSA?") == ["REGMSA=7680"]
    assert unit.take("COORDDISCONT?") == ["COORDDISCONT=1"]
    assert made().take("REGMSA?") == []


def test_the_public_client_s_opening_is_understood_but_for_its_misspelling() -> None:
    """The order of lines of ctu_crs 1.0.6 (docs/sources.md, "Public clients")."""
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
