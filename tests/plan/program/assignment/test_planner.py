"""Sequences whose clearance is lost in whole counts are written anew."""

from __future__ import annotations

import pytest

from arm.errors import ImpossibleError
from arm.plan_file import Step
from plan.budget import Meter, SearchBudget
from plan.program.assignment.planner import AssignmentPlanner
from plan.program.assignment.search import Found, TaskSearch
from plan.program.writer import ClearanceLost
from plans.small_search import OPTIONS, planner_of
from tasks.task2 import task2


def test_all_paths_are_tried_if_there_are_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A place may have sixteen, and each may fail once it is timed; here all but those of the last few branches."""
    case = task2(cubes=1)
    planner = planner_of(case, OPTIONS)
    search = planner.search()
    written, left = AssignmentPlanner.written, [12]

    def failing(self: AssignmentPlanner, search: TaskSearch, found: Found) -> list[Step]:
        if left[0]:
            left[0] -= 1
            raise ClearanceLost(1, ImpossibleError("too near", pair=["palm", "table"], role="approach"))
        return written(self, search, found)

    monkeypatch.setattr(AssignmentPlanner, "written", failing)
    steps, _ = planner.steps(search, Meter(SearchBudget()))
    assert steps
    assert left == [0]
