"""What a unit is told when it is taken into use."""

from __future__ import annotations

from dataclasses import replace

import pytest

from arm.controller.unit import load_unit
from driver.mars.startup import slow_registers


@pytest.mark.parametrize("name", ["crs93", "crs97"])
def test_a_careful_move_is_five_times_slower_and_never_stands(name: str) -> None:
    unit = load_unit(name)
    slow = slow_registers(unit)
    assert [5 * r for r in slow] == pytest.approx(unit.speed_registers, abs=2.5)
    assert slow_registers(replace(unit, speed_registers=(1, 2, 3, 7, 8, 10))) == (1, 1, 1, 1, 2, 2)
