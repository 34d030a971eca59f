"""States in which nothing is to move: each alone is refused, and what is sound is not."""

from __future__ import annotations

import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from driver.line.protocol import Status
from driver.mars.refusals import refuse_faults, refuse_unhomed
from wire.soft_home import SOFT_HOME


@pytest.mark.parametrize(
    ("word", "fault"),
    [(0x8, "an axis is in error"), (0x10000, "arm power is off"), (0x20000, "motion stop is pressed")],
)
def test_each_fault_refuses(word: int, fault: str) -> None:
    for other in (0, 0x10, 0x80):
        with pytest.raises(ImpossibleError, match=fault) as refused:
            refuse_faults(Status(word | other))
        assert refused.value.data["faults"] == [fault]


def test_what_is_no_fault_does_not_refuse() -> None:
    for word in (0, 0x1, 0x10, 0x80, 0x40000):
        refuse_faults(Status(word))


@pytest.mark.parametrize("axis", range(6))
def test_counts_that_no_homed_arm_has_are_refused(unit: Unit, axis: int) -> None:
    refuse_unhomed(unit, SOFT_HOME)
    for bound in (unit.lower, unit.upper):
        q = unit.positions(SOFT_HOME).copy()
        beyond = 1.0 if bound is unit.upper else -1.0
        q[axis] = bound[axis] - 1e-3 * beyond
        refuse_unhomed(unit, unit.counts(q))
        q[axis] = bound[axis] + 1e-3 * beyond
        with pytest.raises(ImpossibleError, match=f"the arm is at .* on axis {unit.axes[axis]}: must be"):
            refuse_unhomed(unit, unit.counts(q))
    for counts in ((0,) * 6, (25, -25, 0, 0, 0, 0)):
        with pytest.raises(
            ImpossibleError, match="as after power-up or an interrupted homing: the unit must be"
        ):
            refuse_unhomed(unit, counts)


def test_an_arm_of_which_only_some_axes_are_homed_is_refused(unit: Unit) -> None:
    """While a group homes, its counters run, those of homed axes and of axes that have not begun are near 0."""
    groups = [tuple(unit.axes.index(axis) for axis in group) for group in unit.homing]
    for group in groups[:2]:
        counts = [9000 if axis in group else (axis - 3) for axis in range(6)]
        with pytest.raises(ImpossibleError, match="the unit must be homed"):
            refuse_unhomed(unit, counts)
    with pytest.raises(ImpossibleError, match="the unit must be homed"):
        refuse_unhomed(unit, [0 if axis < 3 else count for axis, count in enumerate(SOFT_HOME)])
    refuse_unhomed(unit, [0 if axis in (3, 4) else count for axis, count in enumerate(SOFT_HOME)])
