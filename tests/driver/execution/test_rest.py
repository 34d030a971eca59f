"""States of an arm after a stop, in words and as JSON; how far an arm is from a place."""

from __future__ import annotations

import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from driver.execution.rest import RestState, farthest, off_by, refuse_outside
from driver.line.protocol import Status


@pytest.mark.parametrize(
    ("word", "told"), [(None, "under power"), (0, "under power"), (0x20000, "motion stop is pressed")]
)
def test_a_fault_is_part_of_what_is_said_of_an_arm_at_rest(unit: Unit, word: int | None, told: str) -> None:
    status = None if word is None else Status(word)
    state = RestState(True, (0,) * 6, status)
    assert told in state.describe(unit)
    assert state.to_json()["status"] == word
    error = state.error("late", unit, reason="deadline")
    assert error.data == {"reason": "deadline", "state": state.to_json()}
    assert str(error) == f"late; {state.describe(unit)}"


def test_an_arm_that_was_not_seen_at_rest_is_told_to_be_moving(unit: Unit) -> None:
    told = RestState(False, (0,) * 6, None, "no answer").describe(unit)
    assert told.startswith("THE ARM MAY STILL BE MOVING (no answer)")


def test_a_note_is_added_to_rest_without_one_and_replaces_no_worse_news(unit: Unit) -> None:
    lost = "its position is lost"
    assert RestState(True, (0,) * 6).noted(lost).describe(unit) == f"the arm has stopped, {lost}"
    for state in (RestState(False, None, None, "no answer"), RestState(True, None, None, "no answer")):
        assert state.noted(lost) == state
    assert RestState(True, (0,) * 6).noted("") == RestState(True, (0,) * 6)


def test_only_axes_beyond_the_tolerance_are_told(unit: Unit) -> None:
    here, there = (0, 25, -26, 0, 0, 1000), (0,) * 6
    assert farthest(here, there) == 1000
    told = off_by(unit, here, there)
    assert "C reads -26, -26 (" in told
    assert "F reads 1000, +1000 (" in told
    assert "B reads" not in told


@pytest.mark.parametrize("axis", range(6))
def test_counts_beyond_a_limit_are_refused_by_more_than_their_rounding(unit: Unit, axis: int) -> None:
    at = unit.counts(unit.upper)
    refuse_outside(unit, at.tolist(), "target")
    at[axis] += 3 if unit.counts_per_rad[axis] > 0 else -3
    with pytest.raises(ImpossibleError, match=f"target .* deg on axis {unit.axes[axis]}: must be from"):
        refuse_outside(unit, at.tolist(), "target")
