"""Registers are read and compared; nothing is set."""

from __future__ import annotations

from typing import Any

import pytest

from arm.controller.unit import Unit
from driver.line.clock import Clock
from driver.line.link import Link
from driver.mars.identity import identify
from driver.mars.start.read_back import ReadBack, read_back
from driver.mars.start.registers import registers_in
from driver.mars.start.startup import axis_lines, gripper_lines, slow_registers


@pytest.fixture
def held(fake: Any, unit: Unit) -> dict[str, str]:
    """The scripted unit answers for what it holds: at first what the unit's file says."""
    held = {
        name: f"{value}" for name, value in registers_in([*axis_lines(unit), *gripper_lines(unit)]).items()
    }

    def hook(line: str) -> list[str] | None:
        return [f"{line[:-1]}={held[line[:-1]]}"] if line[:-1] in held else None

    for name in held:
        fake.hooks[name] = hook
    return held


def read(fake: Any, unit: Unit, clock: Clock, speed: tuple[int, ...] | None = None) -> ReadBack:
    link = Link(fake.line, clock)
    identify(link, unit.firmware)
    fake.lines.clear()
    found = read_back(link, unit, speed or unit.speed_registers, unit.acceleration_registers)
    link.synchronise()  # what was sent has arrived
    assert {line for line in fake.lines if ":" in line and not line.startswith("STAMP:")} == set()
    return found


def test_a_unit_as_its_file_says_is_right_and_each_register_counts(
    fake: Any, unit: Unit, clock: Clock, held: dict[str, str]
) -> None:
    found = read(fake, unit, clock)
    assert (found.wrong, found.unanswered) == ((), ())
    assert found.limits == {
        f"{name}{axis}": held[f"{name}{axis}"] for name in ("REGMS", "REGACC") for axis in unit.axes
    }
    assert len(found.limits) + found.others == len(held)


@pytest.mark.parametrize("name", ["REGMSA", "REGACCF", "REGMEC", "REGIB", "IDLEREL", "REGMEG"])
def test_one_other_value_is_named_with_what_it_must_be(
    fake: Any, unit: Unit, clock: Clock, held: dict[str, str], name: str
) -> None:
    right, held[name] = held[name], "77"
    assert read(fake, unit, clock).wrong == (f"{name} reads 77, must be {right}",)


def test_the_limits_of_the_cell_are_right_too(
    fake: Any, unit: Unit, clock: Clock, held: dict[str, str]
) -> None:
    slow = slow_registers(unit)
    for axis, value in zip(unit.axes, slow, strict=True):
        held[f"REGMS{axis}"] = f"{value}.0"
    assert len(read(fake, unit, clock).wrong) == 6
    assert read(fake, unit, clock, slow).wrong == ()


def test_what_is_not_answered_is_told_and_proves_nothing(
    fake: Any, unit: Unit, clock: Clock, held: dict[str, str]
) -> None:
    del held["REGACCD"]
    assert read(fake, unit, clock).unanswered == ("REGACCD",)
    held.clear()
    found = read(fake, unit, clock)
    assert (len(found.unanswered), found.limits, found.others, found.wrong) == (12, {}, 0, ())
