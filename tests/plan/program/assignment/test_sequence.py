"""A found assignment as goals in order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from plan.program.assignment.legs import HOME
from plan.program.assignment.sequence import task_targets
from plans.small_search import OPTIONS, planner_of
from tasks.task2 import task2


@pytest.mark.parametrize("look", ["each", "never"])
def test_a_cube_is_picked_placed_and_followed_by_home_where_the_arm_looks(look: str) -> None:
    case = task2(cubes=2)
    options = replace(OPTIONS, look=look)
    planner = planner_of(case, options)
    search = planner.search()
    found = search.best()
    targets = task_targets(found, search.worlds, planner.q_start, options)
    goals = [planned.leg.goal.site for planned in found.legs]
    kinds = ["home" if goal == HOME else "place" if goal.placed else "source" for goal in goals]
    per_cube = ["source", "place", "home"] if look == "each" else ["source", "place"]
    assert kinds == per_cube * 2 + (["home"] if look == "never" else [])
    picks = [t for t in targets if t.attach]
    places = [t for t in targets if t.detach]
    assert [t.attach for t in picks] == [t.subject for t in places]
    assert {t.cube for t in targets} == {0, 1}
    assert all(t.jaws == options.fraction_closed for t in picks)
    assert all(t.jaws == 0.0 for t in places)
    homes = [t for t in targets if t.role == "home"]
    assert all(np.array_equal(t.q, planner.q_start) and t.look == (look == "each") for t in homes)
