"""A unit taken into use: which controller it is, homing and soft home, the registers, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from driver.emulator import Emulator
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from driver.mars.identity import gripper_answers, refuse_another
from driver.mars.mars import Mars
from driver.mars.startup import limit_lines, move_time
from wire.soft_home import SOFT_HOME


@pytest.mark.parametrize("version", ["LX_ROCON v2", "MARS81 x", "", "mars8"])
def test_another_controller_is_refused_untouched(fake: Any, unit: Unit, clock: Clock, version: str) -> None:
    fake.hooks["VER"] = lambda line: [f"VER={version}"]
    with Mars(fake.line, unit, clock) as mars, pytest.raises(InputError, match="is not MARS8"):
        mars.identify()
    assert {line.split(":")[0] for line in fake.lines} <= {"", "ECHO", "STAMP", "VER?"}


def test_something_that_only_echoes_is_refused(fake: Any, unit: Unit, clock: Clock) -> None:
    for name in ("STAMP", "VER", "ECHO"):
        fake.hooks[name] = lambda line: [line]
    with (
        Mars(fake.line, unit, clock) as mars,
        pytest.raises(InputError, match="does not answer like a MARS8"),
    ):
        mars.identify()
    assert {line.split(":")[0] for line in fake.lines} <= {"", "ECHO", "STAMP"}


def test_power_up_noise_does_not_hide_the_unit(fake: Any, unit: Unit, clock: Clock) -> None:
    fake.echo = False  # an echoed line end would separate the noise from the answer
    fake.write(b"\xff\x00\x80MARS")  # half a line of noise that spoils the first answer
    with Mars(fake.line, unit, clock) as mars:
        assert mars.identify().startswith("MARS8 v1.0")


def test_nothing_moves_before_identify(fake: Any, unit: Unit, clock: Clock) -> None:
    with Mars(fake.line, unit, clock) as mars, pytest.raises(InputError, match=r"call identify\(\) first"):
        mars.initialise()
    assert fake.lines == []


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


@pytest.mark.parametrize("name", ["crs93", "crs97"])
def test_another_units_gripper_axis_is_refused_before_anything_is_set(name: str) -> None:
    """Both ways round: the emulated unit is one arm, the cell file says the other."""
    clock = SteppedClock()
    is_there, said = load_unit(name), load_unit("crs97" if name == "crs93" else "crs93")
    with Emulator(is_there, clock) as emulator, Mars(emulator.open_line(), said, clock) as mars:
        mars.identify()
        with pytest.raises(InputError, match=f"unit = {said.name}") as refused:
            mars.initialise()
        assert refused.value.exit_code == 2
        assert refused.value.data["answers"][said.gripper.axis] == "0"
        assert f"AP{is_there.gripper.axis} = " in str(refused.value)
        set_or_moved = ("REG", "HH", "COORD", "PURGE", "SPDT", "ANAX", "STOP")
        assert not [line for _, line in emulator.lines if line.startswith(set_or_moved)]
        with pytest.raises(InputError, match="this is another arm"):
            mars.initialise(home=False)


@pytest.mark.parametrize("silent", [[], ["AP{}=0"], ["FAIL!"]])
@pytest.mark.parametrize("answered", [(), ("G", "H"), ("G",)])
def test_which_gripper_axis_answers_is_never_proof(
    fake: Any, unit: Unit, answered: tuple[str, ...], silent: list[str]
) -> None:
    """No answer, or both, or the right one: it goes on as it would, and the log has what was answered."""
    for axis in "GH":
        said = [f"AP{axis}=840"] if axis in answered else [text.format(axis) for text in silent]
        fake.hooks[f"AP{axis}"] = lambda line, said=said: said
    told: list[dict[str, Any]] = []
    with Mars(fake.line, unit, fake.clock) as mars:
        mars.identify()
        mars.note = lambda kind, **data: told.append({"kind": kind, **data})  # type: ignore[method-assign]
        answers = gripper_answers(mars.link)
        refuse_another(unit, answers)
        assert {axis for axis, text in answers.items() if text == "840"} == set(answered)
        mars.initialise()
    (whose,) = [note for note in told if note["kind"] == "whose_arm"]
    assert whose["gripper_axes"] == answers
    assert whose["unit"] == unit.name


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


@pytest.mark.parametrize("text", ["840", "-840", " 1001 "])
def test_any_whole_number_but_nought_is_a_gripper(unit: Unit, text: str) -> None:
    own = unit.gripper.axis
    (other,) = {"G", "H"} - {own}
    for nothing in ("0", "-0", None, "FAIL!", ""):
        with pytest.raises(InputError, match="this is another arm"):
            refuse_another(unit, {own: nothing, other: text})
        refuse_another(unit, {own: text, other: nothing})
        refuse_another(unit, {own: nothing, other: nothing})
    refuse_another(unit, {own: text, other: text})
