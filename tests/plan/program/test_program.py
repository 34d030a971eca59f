"""Programs: transfers and goals in one list, from one end to the next."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from arm.errors import InputError
from arm.plan_file import GripperStep, Move
from arm.se3 import transform
from plan.program.assignment.planner import Transfers
from plan.program.goals.attachments import AttachmentState
from plan.program.goals.target import Target
from plan.program.program import Program, plan_program
from plan.scene import scene_from_json
from plan.verify import replay
from plans.small_search import OPTIONS, UNIT
from tasks.task2 import Q_START, task2

ASIDE = np.radians([30.0, -40.0, -80.0, 0.0, -60.0, 0.0])


@pytest.fixture(scope="module")
def program() -> Program:
    """One cube, then a configuration, a pose, and another cube."""
    case = task2(cubes=2)
    first, second = case.transfers
    above = case.scene.robot_open.T_base_tool(ASIDE) @ transform(t=(0.0, 0.0, -0.05))
    goals = (
        Transfers((first,)),
        Target("aside", q=ASIDE),
        Target("above", above, by="line"),
        Transfers((second,)),
    )
    return Program(case.scene, goals, Q_START, UNIT, options=OPTIONS, task={"name": "both"})


def test_transfers_and_goals_follow_each_other(program: Program) -> None:
    planned = plan_program(program)
    moves = planned.moves
    assert all(a.path.end == b.path.start for a, b in pairwise(moves))
    assert [cube["cube"] for cube in planned.cubes] == ["cube 1", "cube 2"]
    assert [r.target for r in planned.reached] == ["aside", "above"]
    served = [step.cube for step in planned.steps if isinstance(step, Move | GripperStep)]
    assert [cube for cube, after in pairwise([*served, 9]) if cube != after] == [None, 0, None, 1]
    assert planned.lower_bound_s <= sum(move.path.duration_s for move in moves)
    # the second task begins and ends where the goals before it end
    assert moves[-1].path.end == tuple(UNIT.counts(planned.reached[-1].q))


def test_the_file_of_a_program_is_verified_with_every_cube_where_it_was_brought(program: Program) -> None:
    plan = plan_program(program).plan()
    assert plan.task["name"] == "both"
    scene = scene_from_json(plan.scene, program.scene.robot_open, program.scene.robot_holding)
    assert len(replay(plan, scene, UNIT, UNIT.limits())) == len(list(plan.moves))


@pytest.mark.parametrize("goals", [(), ("here",)])
def test_what_is_no_goal_is_refused(program: Program, goals: tuple[object, ...]) -> None:
    with pytest.raises(InputError, match="must be at least one Target or Transfers"):
        plan_program(replace(program, goals=goals))  # type: ignore[arg-type]


def test_nothing_may_be_held_where_transfers_begin(program: Program) -> None:
    held = AttachmentState("cube 1", transform(t=(0.0, 0.0, 0.02)), ())
    with pytest.raises(InputError, match="cube 1 moves with the tool where transfers begin"):
        plan_program(replace(program, state=held))
