"""A found assignment as goals in order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plan.program.assignment.sequence import Leg, task_sequence
from plans.small_search import OPTIONS, planner_of
from tasks.task2 import task2


@pytest.mark.parametrize("look", ["each", "never"])
def test_a_cube_is_picked_placed_and_followed_by_home_where_the_arm_looks(look: str) -> None:
    case = task2(cubes=2)
    options = replace(OPTIONS, look=look)
    planner = planner_of(case, options)
    search = planner.search()
    sequence = task_sequence(search.best(), search.stages, planner.q_start, options)
    per_cube = ["out", "across", "home"] if look == "each" else ["out", "across"]
    assert [leg.which for leg in sequence.legs] == per_cube * 2 + (["home"] if look == "never" else [])
    picks = [t for t in sequence.targets if t.attach]
    places = [t for t in sequence.targets if t.detach]
    assert [t.attach for t in picks] == [t.subject for t in places]
    assert {t.cube for t in sequence.targets} == {0, 1}
    assert all(t.jaws == options.fraction_closed for t in picks)
    assert all(t.jaws == 0.0 for t in places)
    homes = [t for t in sequence.targets if t.role == "home"]
    assert all(np.array_equal(t.q, planner.q_start) and t.look == (look == "each") for t in homes)


def test_the_line_out_of_a_goal_belongs_to_the_leg_that_it_begins() -> None:
    """The search forbids a leg by its stop, and knows by the role which of its two lines is meant."""
    case = task2(cubes=2)
    options = replace(OPTIONS, look="each")
    planner = planner_of(case, options)
    search = planner.search()
    sequence = task_sequence(search.best(), search.stages, planner.q_start, options)
    assert sequence.leg(0, "approach") == Leg(0, "out")
    assert sequence.leg(0, "retract") == Leg(0, "across")
    assert sequence.leg(1, "retract") == Leg(0, "home")
    assert sequence.leg(2, "home") == Leg(0, "home")
    assert sequence.leg(3, "transit") == Leg(1, "out")
