"""Moves of single axes, and the gripper's jaws."""

from __future__ import annotations

import pytest

from emulated.lineless_unit import finish, made


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
