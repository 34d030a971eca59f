"""Homing is proved axis by axis, and group by group before the next one moves."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from arm.errors import ExecutionStopped
from driver.mars.mars import Mars
from driver.mars.start.homing import HOMING_TOLERANCE, _home_axes, home_all


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", range(6))
def test_an_axis_that_has_left_its_mark_when_all_are_homed_is_told(mars: Mars, axis: int, sign: int) -> None:
    def left(by: int) -> tuple[int, ...]:
        return tuple(sign * by * (k == axis) for k in range(6))

    home_all(mars.link, mars.unit, lambda: left(2000))
    with pytest.raises(
        ExecutionStopped, match=f"axis {'ABCDEF'[axis]} reads {sign * 2001} counts at its mark"
    ) as stopped:
        home_all(mars.link, mars.unit, lambda: left(2001))
    assert stopped.value.data["reason"] == "homing"


def test_an_axis_that_did_not_reach_its_mark_ends_homing_before_the_next_group_moves(
    mars: Mars, fake: Any
) -> None:
    first, *others = mars.unit.homing

    def short(line: str) -> list[str] | None:
        if line != f"HH{first[0]}:":
            return None
        fake.counts["ABCDEF".index(first[0])] = HOMING_TOLERANCE + 500
        return []

    fake.hooks["HH"] = short
    fake.lines.clear()
    with pytest.raises(ExecutionStopped, match=f"axis {first[0]} reads {HOMING_TOLERANCE + 500} counts"):
        home_all(mars.link, mars.unit, mars.settled_counts)
    assert not any(line == f"HH{axis}:" for group in others for axis in group for line in fake.lines)


def test_an_arm_that_failed_to_home_has_lost_its_position(
    mars: Mars, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise ExecutionStopped("axis A reads 9000 counts at its mark", reason="homing")

    monkeypatch.setattr("driver.mars.session.home_all", fails)
    with pytest.raises(
        ExecutionStopped, match="at its mark; the arm has stopped, its position is lost"
    ) as told:
        mars.initialise()
    assert told.value.data["reason"] == "homing"


@pytest.mark.parametrize(("looks", "moved"), [((0, 2, 4), True), ((0, 2, 2), False), ((0, -3, 0), True)])
def test_an_axis_was_seen_to_move_if_it_ever_was_elsewhere_than_at_first(
    mars: Mars, monkeypatch: pytest.MonkeyPatch, looks: tuple[int, ...], moved: bool
) -> None:
    """By more than two counts, which an arm at rest may show; one that was not seen to is homed once more."""
    seen = iter([SimpleNamespace(counts=(place,) + (0,) * 5) for place in looks])
    monkeypatch.setattr("driver.mars.start.homing.read_position", lambda *_: next(seen))
    monkeypatch.setattr("driver.mars.start.homing.wait_ready", lambda *_, on_poll: on_poll())
    assert _home_axes(mars.link, mars.unit, ("A",)) == (() if moved else ("A",))
