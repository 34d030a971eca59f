"""What the time of a sequence consists of."""

from __future__ import annotations

import pytest

from plan.program.assignment.found import explained
from plans.small_search import CASES, search_of


@pytest.mark.parametrize("name", CASES)
def test_the_excess_by_cause_adds_up(name: str) -> None:
    search = search_of(*CASES[name])
    found = search.best()
    gap = found.gap
    assert gap.order + gap.straight + gap.around == pytest.approx(found.time - found.bound, abs=1e-9)
    assert min(gap.order, gap.straight, gap.around) >= -1e-9
    around = any(len(planned.path) > 2 for planned in found.legs)
    assert (gap.around > 1e-3) == around
    again = explained(found, search.costs, 1.5)
    assert again.gap.unexplored == 1.5
    assert again.gap.order == gap.order
    assert explained(found, search.costs, -1.0).gap.unexplored == 0.0
