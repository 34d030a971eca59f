"""Programs: transfers and goals in one list, from one end to the next."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from arm.plan_file import GripperStep, Move
from arm.robot.shapes import Body, Box, Sphere
from arm.se3 import rot_x, transform
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
    with pytest.raises(InputError, match="cube 1 is attached where transfers begin"):
        plan_program(replace(program, state=held))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"scene": None}, "scene = None: must be a Scene"),
        ({"unit": None}, "unit = None: must be a Unit"),
        ({"options": {}}, "options = .*: must be a PlanOptions"),
        ({"goals": None}, "goals = None: must be a tuple"),
        ({"padding": 0.003}, "padding = 0.003 m: must be 0 with transfers"),
        ({"state": AttachmentState("x", transform(), ()), "goals": (Target("a", q=ASIDE),)}, "held = 'x'"),
    ],
)
def test_what_a_program_cannot_be_made_of_is_refused(
    program: Program, change: dict[str, Any], says: str
) -> None:
    with pytest.raises(InputError, match=says):
        plan_program(replace(program, **change))


def test_only_what_can_be_moved_is_attached(program: Program) -> None:
    """A plan file moves the scene's cubes; one that carried a wall could not be verified."""
    plate = program.scene.bodies[-1]
    goal = Target("it", plate.T_base_body @ transform(rot_x(np.pi)), attach=plate.name)
    with pytest.raises(InputError, match="must be one of the scene's cubes"):
        plan_program(replace(program, goals=(goal,)))


def test_jaws_that_close_count_as_closed_from_then_on(program: Program) -> None:
    """A rod between the open fingers is clear of them until they close; the plan and its file agree on that."""
    scene, free = program.scene, Target("free", q=ASIDE, jaws=0.0)
    tips = scene.robot_open.T_base_tool(ASIDE) @ transform(t=(0.0, 0.0, -0.01))
    rod = Body("rod", Sphere(0.005), tips, "post")
    scene = replace(scene, bodies=(*scene.bodies, rod))
    goals = free, Target("home", q=Q_START)
    planned = plan_program(replace(program, scene=scene, goals=goals))
    made = scene_from_json(planned.plan().scene, scene.robot_open, scene.robot_holding)
    replay(planned.plan(), made, UNIT, UNIT.limits())
    with pytest.raises(ImpossibleError, match="rod"):
        plan_program(replace(program, scene=scene, goals=(replace(free, jaws=1.0), goals[1])))


@pytest.mark.few(1)
@pytest.mark.parametrize("jaws", [None, 0.9])
def test_the_file_says_what_is_attached_whether_jaws_close_or_not(
    program: Program, jaws: float | None
) -> None:
    at = transform(rot_x(np.pi), (0.35, -0.25, 0.3))
    lump = Body("lump", Box((0.03, 0.03, 0.03)), at, "cube")
    scene = replace(program.scene, cubes=(*program.scene.cubes, lump))
    touching = [("lump", name) for name in ("finger_l", "finger_r", "palm")]
    take = Target(
        "it",
        at,
        free="rz",
        approach=0.05,
        retract=0.05,
        attach="lump",
        jaws=jaws,
        allowed_collisions=touching,
    )
    planned = plan_program(replace(program, scene=scene, goals=(take, Target("aside", q=ASIDE))))
    made = scene_from_json(planned.plan().scene, scene.robot_open, scene.robot_holding)
    assert replay(planned.plan(), made, UNIT, UNIT.limits())[-1].move.held == "lump"
