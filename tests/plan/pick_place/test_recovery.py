"""The way of a cube that a stop left in the jaws: it keeps what its ends leave, and never less than asked."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.se3 import Array
from plan.collision.margin import MARGIN
from plan.options import PlanOptions
from plan.pick_place.recovery import _Carry

ASKED = PlanOptions().clearance


class _Room:
    """A world in which each end (named by its first joint) keeps a distance."""

    def __init__(self, *distances: float) -> None:
        self.distances = distances

    def distance(self, q: Array) -> Any:
        return SimpleNamespace(value=self.distances[int(q[0])])

    def in_collision(self, q: Array, clearance: float) -> bool:
        return self.distances[int(q[0])] < clearance


@pytest.mark.parametrize(
    ("begins", "ends", "searched"),
    [
        (1.0, 1.0, ASKED + MARGIN),
        (ASKED + MARGIN / 2, 1.0, ASKED + MARGIN / 4),  # where the stop left it
        (1.0, ASKED + MARGIN / 2, ASKED + MARGIN / 4),  # above the place
        (ASKED + MARGIN / 2, ASKED + MARGIN / 8, ASKED + MARGIN / 16),
        (ASKED, 1.0, ASKED),
        (ASKED / 2, 1.0, ASKED),
    ],
)
def test_the_way_of_a_held_cube_is_searched_with_the_margin_that_its_ends_leave(
    monkeypatch: pytest.MonkeyPatch, begins: float, ends: float, searched: float
) -> None:
    """A margin that an end cannot keep would refuse every way from there."""
    asked: list[float] = []

    def plan_transit(world: Any, q_from: Array, q_to: Array, limits: Any, clearance: float, *_: Any) -> Array:
        asked.append(clearance)
        return np.stack([q_from, q_to])

    monkeypatch.setattr("plan.pick_place.recovery.plan_transit", plan_transit)
    carry = _Carry.__new__(_Carry)
    carry.options = PlanOptions()
    carry.planner = SimpleNamespace(planned=None)  # type: ignore[assignment]
    room: Any = _Room(begins, ends)
    carry.across(room, np.zeros(6), np.ones(6))
    assert asked == [pytest.approx(searched, abs=1e-12)]
