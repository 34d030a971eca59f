"""What a search notes about legs: what is forgotten when it starts again with more effort, and what is not."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.se3 import frozen
from plan.options import PlanOptions
from plan.program.assignment.leg_costs import CARRY, NOT_NOW, TransitCosts, TransitEdge
from plan.program.assignment.leg_times import line_ends, standing
from plan.program.assignment.sequencing import Progress
from plan.program.assignment.worlds import CubePlacement

LIMITS = load_unit("crs93").limits()
NOTHING_DONE = Progress(frozenset(), frozenset())


def costs() -> TransitCosts:
    """One cube and one place with two ways each."""
    line = np.linspace(0.0, 0.1, 5)[:, None] * np.ones(6)
    ends = line_ends([frozen(line), frozen(line + 0.2)], 0.1, LIMITS, None)
    return TransitCosts([ends], [ends], standing(np.zeros(6)), LIMITS, PlanOptions())


@pytest.mark.parametrize("by", [None, CubePlacement(False, 0)])
def test_what_had_no_budget_is_asked_again_and_what_could_not_be_proved_is_not(
    by: CubePlacement | None,
) -> None:
    noted = costs()
    legs = [TransitEdge(CARRY, (0, 0), ways) for ways in ((0, 0), (0, 1), (1, 0), (1, 1))]
    noted.block(legs[0], by, NOT_NOW)
    noted.block(legs[1], by, np.inf)
    noted.forbid(legs[2], by)
    noted.block(legs[3], by, 2.5)

    noted.ask_again()

    assert [noted.time(leg, by) for leg in legs] == [None, None, np.inf, 2.5]


def test_only_a_forbidden_leg_has_infinite_cost() -> None:
    noted = costs()
    before = noted.now().carry(0, 0, NOTHING_DONE)
    noted.forbid(TransitEdge(CARRY, (0, 0), (1, 0)), None)
    noted.ask_again()
    after = noted.now().carry(0, 0, NOTHING_DONE)
    assert np.isfinite(before).all()
    assert np.isinf(after[1, 0])
    untouched = np.array([[True, True], [False, True]])
    assert (after[untouched] == before[untouched]).all()
