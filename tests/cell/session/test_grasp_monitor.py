"""What the jaws hold: a cube's width within its tolerance, and lost only if look after look says so."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from arm.errors import ExecutionStopped
from cell.session.grasp_monitor import GRIP_CHANGE, READINGS, GraspMonitor, grip_fault


@pytest.mark.parametrize(
    ("width_mm", "told"),
    [
        (40.0, ""),
        (43.0, ""),
        (37.0, ""),
        (43.2, "something else is between them"),
        (36.8, "they hold something else, or a cube by its edge"),
        (0.0, "they hold something else, or a cube by its edge"),
    ],
)
def test_a_cube_is_gripped_at_its_width_and_no_narrower_or_wider(width_mm: float, told: str) -> None:
    cell: Any = SimpleNamespace(cube_size=0.040, grip_tolerance=0.003, cube_tolerance=1e-4)
    why_not = grip_fault(cell, width_mm / 1e3)
    assert bool(why_not) is bool(told)
    assert told in why_not
    assert not why_not or f"the jaws stopped {width_mm:.1f} mm apart, a cube is 40 +- 3.1 mm wide" in why_not


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_cube_is_lost_when_as_many_looks_in_a_row_say_so_as_are_asked_for(sign: float) -> None:
    """Between them one look at which the jaws are where they closed begins anew."""
    held, away = GraspMonitor("cube 1", 0.5), 0.5 + sign * 1.01 * GRIP_CHANGE
    for _ in range(3):
        for _ in range(READINGS - 1):
            held.require(away)
        held.require(0.5 + sign * 0.99 * GRIP_CHANGE)
    for _ in range(READINGS - 1):
        held.require(away)
    with pytest.raises(ExecutionStopped, match="cube 1 was lost: the jaws were 50 % closed") as lost:
        held.require(away)
    assert lost.value.data["reason"] == "lost"
    with pytest.raises(ExecutionStopped):
        GraspMonitor("cube 1", 0.5).require(away, readings=1)
