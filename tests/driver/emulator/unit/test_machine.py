"""The emulated unit without its line: whatever it is told, for however long, it neither falls over nor grows."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
from hypothesis import example, given, settings

from driver.emulator import EmulatorOptions, Fault
from driver.emulator.commands import Interpreter
from driver.emulator.unit.machine import Machine
from emulated.lineless_unit import UNIT, finish, grouped, made
from emulated.random_lines import lines


@example(
    [(f"REG{name}A:2147483647", 0) for name in ("MS", "ACC")]
    + [("COORDRELMVT:1,2147483647,0,0,0,0,0", 900)] * 2
)
@example([("GA:nan", 1), ("COORDMV:inf,0,0,0,0,0", 1), ("SPDA:1e300", 1), ("REGMSA:nan", 1)])
@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.lists(st.tuples(lines, st.integers(0, 60)), max_size=40))
def test_any_lines_at_any_time_leave_a_unit_that_answers(script: list[tuple[str, int]]) -> None:
    unit = Interpreter(Machine(UNIT, None, EmulatorOptions(keep_lines=50, keep_ms=100)))
    unit.take("COORDGRP:A,B,C,D,E,F")
    for line, ms in script:
        for answer in unit.take(line):
            assert answer.isascii()
            assert "\n" not in answer
        unit.machine.run(ms)
        unit.ready()
    (status,) = unit.take("ST?")[:1]
    assert 0 <= int(status.removeprefix("ST=")) < 2**18
    unit.take("STOP:")
    unit.machine.run(10)
    assert unit.take("STAMP:5")[0] == "STAMP=5"
    assert len(unit.lines) <= 50
    assert len(unit.machine.recorder) <= 113


def test_what_is_remembered_is_bounded_unless_all_is_asked_for() -> None:
    bounded = Interpreter(Machine(UNIT, None, EmulatorOptions()))
    assert bounded.lines.maxlen == bounded.ignored.maxlen == bounded.machine.violations.maxlen == 100_000
    everything = Interpreter(Machine(UNIT, None, EmulatorOptions(keep_lines=None, keep_ms=None)))
    assert everything.lines.maxlen is None
    few = Interpreter(Machine(UNIT, None, EmulatorOptions(keep_lines=3)))
    for number in range(10):
        few.take(f"FOO:{number}")
        few.machine.violate(str(number))
    assert [text for _, text in few.ignored] == ["FOO:7", "FOO:8", "FOO:9"]
    assert [violation.what for violation in few.machine.violations] == ["7", "8", "9"]
    assert few.machine.violated == 10


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
    assert not any(unit.machine.offset)


def test_a_stopped_homing_is_no_homing() -> None:
    unit = grouped()
    unit.take("HHA:")
    unit.machine.run(500)
    unit.take("STOP:")
    finish(unit)
    assert unit.machine.offset[0]
    assert unit.machine.true_counts()[0] != 0


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
    assert unit.machine.path.at[0] == 2000
    full = grouped(EmulatorOptions(overflow="fail", queue=1))
    full.take("COORDMV:1,0,0,0,0,0")
    assert full.take("COORDMV:2,0,0,0,0,0") == ["FAIL!"]


def test_a_segment_after_stop_starts_where_the_arm_stopped() -> None:
    unit = grouped()
    unit.take("COORDMV:20000,0,0,0,0,0")
    unit.machine.run(300)
    unit.take("STOP:")
    unit.take("COORDRELMVT:100,0,50,0,0,0,0")
    finish(unit)
    a, b, *_ = unit.machine.path.at
    assert 0 < a < 20000
    assert b == 50


def test_a_power_cycle_leaves_nothing_of_before_but_the_arm_where_it_is() -> None:
    """In the middle of a motion, with closing jaws, an axis in error, another that drifts, and an error at rest."""
    unit = grouped(EmulatorOptions(static_error=9, seed=2))
    machine = unit.machine
    unit.take("COORDMV:900,0,0,0,0,0")
    finish(unit)
    machine.following.begin(Fault("drift", axis="B", counts_per_s=500.0), machine.path.at)
    machine.run(1000)
    unit.take("GG:103")
    unit.take("COORDMV:90000,0,0,0,0,0")
    machine.run(200)
    machine.axis_errors.add("C")
    stood = np.array(machine.true_counts())
    machine.power_cycle()
    assert np.abs(stood - machine.true_counts()).max() <= 9
    assert machine.actual() == (0,) * 6
    assert not machine.busy
    assert unit.take("ST?") == ["ST=0"]
    assert unit.take("COORDAP?") == []  # no group
    unit.take("COORDGRP:A,B,C,D,E,F")
    unit.take("COORDMV:10,0,0,0,0,0")
    assert unit.take("COORDAP?")[0].startswith("COORDAP=0,1,")  # its clock and its segments begin anew


def test_purge_then_stop_when_idle_leaves_it_idle() -> None:
    unit = made()
    unit.take("PURGE:")
    unit.take("STOP:")
    assert unit.take("ST?") == ["ST=0"]


def test_contact_moves_jaws_and_what_the_counters_say() -> None:
    class Slippery:
        slipped = 0

        def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
            return 500

        def jaws_now(self, counts: tuple[int, ...], adc: int) -> int:
            return self.slipped or adc

        def pushed_back(self, counts: tuple[int, ...]) -> tuple[int, ...]:
            return (7, 0, 0, 0, 0, -2)

    plant = Slippery()
    machine = Machine(UNIT, plant, EmulatorOptions())
    machine.move_axis(UNIT.gripper.axis, UNIT.gripper.closed_adc)
    plant.slipped = 130
    assert machine.jaws_adc() == UNIT.gripper.open_adc  # the move is not finished
    machine.run(3000)
    assert machine.jaws_adc() == machine.jaws.adc == 130
    assert np.subtract(machine.read(), machine.actual()).tolist() == [7, 0, 0, 0, 0, -2]
    unit = Interpreter(machine)
    unit.take(f"COORDGRP:{','.join(UNIT.axes)}")
    said = unit.take("COORDAP?")[0].split(",")[3:]
    assert [int(c) for c in said] == list(machine.read())
    assert unit.take(f"AP{UNIT.axes[0]}?") == [f"AP{UNIT.axes[0]}={machine.read()[0]}"]
