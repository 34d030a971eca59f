"""Joint limits, which the unit does not enforce."""

from __future__ import annotations

from emulated.lineless_unit import finish, grouped


def test_leaving_the_limits_is_noted_and_not_prevented() -> None:
    unit = grouped()
    for axis in "ABCDEF":
        unit.take(f"HH{axis}:")
    finish(unit)
    unit.machine.violations.clear()
    unit.take("COORDMV:0,200000,0,0,0,0")
    finish(unit)
    assert unit.machine.path.at[1] == 200000
    assert len(unit.machine.violations) == 1
    assert "axis B" in unit.machine.violations[0].what
