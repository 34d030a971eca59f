"""Registers are read back after every change, where the unit answers."""

from __future__ import annotations

from typing import Any

import pytest

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from arms.count_paths import quintic
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.line.clock import Clock
from driver.line.link import ASKED_AT_ONCE
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.start.startup import slow_registers
from driver.mars.streaming.stream import stream
from emulated.near_marks import near_marks


def asked(lines: list[str]) -> list[str]:
    return [
        line[:-1] for line in lines if line.endswith("?") and line.startswith(("REG", "IDLEREL", "COORDDI"))
    ]


@pytest.fixture
def holding(fake: Any) -> Any:
    """The scripted unit remembers its registers and answers for them."""
    held: dict[str, str] = {}

    def hook(line: str) -> list[str] | None:
        name, mark, value = line.partition(":")
        if mark:
            held[name] = value
            return None
        return [f"{line[:-1]}={held[line[:-1]]}"] if line[:-1] in held else None

    for name in ("REGMS", "REGACC", "REGP", "REGI", "REGD", "REGME", "REGS1", "REGS2", "REGCFG"):
        for axis in "ABCDEFG":
            fake.hooks[name + axis] = hook
    fake.hooks["IDLEREL"] = fake.hooks["COORDDISCONT"] = hook
    fake.held = held
    return fake


def test_every_register_that_is_told_is_read_back(holding: Any, unit: Unit, clock: Clock) -> None:
    with Mars(holding.line, unit, clock) as mars:
        mars.identify()
        mars.initialise()
        assert set(asked(holding.lines)) == set(holding.held)
        assert mars.registers.answers["REGMSB"] == "2048"
        holding.lines.clear()
        mars.set_registers(slow_registers(unit), unit.acceleration_registers)
        assert set(asked(holding.lines)) == {r + a for r in ("REGMS", "REGACC") for a in unit.axes}
        holding.lines.clear()
        mars.set_registers(unit.speed_registers, unit.acceleration_registers)
        stream(mars, quintic(mars.reference or (0,) * 6, 10, (100,) * 6))
        assert "COORDDISCONT" in asked(holding.lines)


def test_a_unit_that_answers_none_is_asked_for_one_of_each_kind_once(
    fake: Any, unit: Unit, clock: Clock
) -> None:
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        mars.initialise()
        kinds = [name[:-1] if name.startswith("REG") else name for name in asked(fake.lines)]
        assert len(kinds) == len(set(kinds)) <= ASKED_AT_ONCE
        fake.lines.clear()
        mars.set_registers(unit.speed_registers, unit.acceleration_registers)
        assert asked(fake.lines) == []


@pytest.mark.parametrize("wrong", ["1536", "76800", "", "x"])
def test_a_register_that_reads_otherwise_twice_is_one_clear_error(
    holding: Any, unit: Unit, clock: Clock, wrong: str
) -> None:
    plain = holding.hooks["REGACCC"]
    with Mars(holding.line, unit, clock) as mars:
        mars.identify()
        mars.initialise()
        holding.hooks["REGACCC"] = lambda line: [f"REGACCC={wrong}"] if line.endswith("?") else plain(line)
        with pytest.raises(
            ExecutionStopped, match=f"register REGACCC reads {wrong} after 20 was set"
        ) as stopped:
            mars.set_registers(unit.speed_registers, unit.acceleration_registers)
        assert stopped.value.data["reason"] == "register"
        assert stopped.value.data["register"] == "REGACCC"


def test_one_damaged_answer_is_asked_for_again(holding: Any, unit: Unit, clock: Clock) -> None:
    plain, spoilt = holding.hooks["REGMSD"], []

    def once(line: str) -> list[str] | None:
        if line.endswith("?") and not spoilt:
            spoilt.append(line)
            return ["REGMSD=7681"]
        return plain(line)

    holding.hooks["REGMSD"] = once
    with Mars(holding.line, unit, clock) as mars:
        mars.identify()
        mars.initialise()
    assert spoilt


def test_a_register_lost_in_the_unit_behind_its_echo_is_noticed(unit: Unit, clock: SteppedClock) -> None:
    """The line came back right; what the unit holds did not change."""
    options = EmulatorOptions(power_up_deg=near_marks(unit), registers_readable=True)
    lost = Fault("lost_bytes", When(command="REGMS"), direction="parser", line=1)
    with Emulator(unit, clock, options=options) as emulator, Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        mars.initialise(soft_home=False)
        emulator.inject(lost)
        with pytest.raises(ExecutionStopped, match="though the echo was right"):
            mars.set_registers(slow_registers(unit), unit.acceleration_registers)
