"""Transfers: sequences whose clearance is lost are written anew, and cubes that cannot move may stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from arm.plan_file import Step
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, transform
from plan.budget import BudgetSpent, Meter, SearchBudget
from plan.collision.world import World
from plan.program.assignment import edge_checks
from plan.program.assignment.found import Found
from plan.program.assignment.planner import AssignmentPlanner, Transfers
from plan.program.assignment.search import TaskSearch
from plan.program.program import Program, plan_program
from plan.program.tasks import plan_task
from plan.program.writer import ClearanceLost
from plan.scene import Transfer, scene_from_json
from plan.transit.optimise import Shortening
from plan.transit.straight import StraightLine
from plan.verify import placed_cubes, replay
from plans.small_search import OPTIONS, UNIT, planner_of
from tasks.task2 import Q_START, WALL, Task2, task2


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


@pytest.mark.few(1)
@pytest.mark.parametrize("blind", [("straight",), ("detours",), ("straight", "detours")])
def test_what_samples_miss_is_mended_after_the_certificate(
    monkeypatch: pytest.MonkeyPatch, blind: tuple[str, ...]
) -> None:
    """Straight motions and detours that were not seen to meet the wall are replaced by certified ones."""
    case, confirmed = task2([WALL], cubes=2), list[bool]()
    seeing = plan_task(case.scene, case.transfers, Q_START, UNIT, UNIT.limits(), OPTIONS)
    if "straight" in blind:
        monkeypatch.setattr(edge_checks, "check_straight", unseen)
    if "detours" in blind:
        monkeypatch.setattr(Shortening, "settled", lambda self: self.path[[0, -1]])
    confirm = TaskSearch.confirm

    def noted(self: TaskSearch, found: Found) -> bool:
        confirmed.append(confirm(self, found))
        return confirmed[-1]

    monkeypatch.setattr(TaskSearch, "confirm", noted)
    plan = plan_task(case.scene, case.transfers, Q_START, UNIT, UNIT.limits(), OPTIONS)
    assert all(move.certified for move in plan.moves)
    assert not confirmed[0]
    assert plan.duration_s < 1.1 * seeing.duration_s


def unseen(world: World, a: Array, b: Array, asked: float, margin: float) -> StraightLine:
    return StraightLine(a, b, asked, True, 0.0)


def fenced() -> Task2:
    """A post where the fingers go in around cube 2."""
    case = task2(cubes=3)
    pick = case.transfers[1].pick
    beside = [pick.T_base_tool[0] @ transform(t=shift) for shift in ((0.045, 0.0, 0.0), (0.0, 0.045, 0.0))]
    posts = [Body(f"post {i}", Box((0.01, 0.01, 0.1)), T, "post") for i, T in enumerate(beside)]
    return replace(case, scene=replace(case.scene, bodies=(*case.scene.bodies, *posts)))


@pytest.mark.slow
def test_a_cube_that_is_blocked_stays_if_that_is_allowed() -> None:
    case = fenced()
    with pytest.raises(ImpossibleError, match="cube 2"):
        plan_task(case.scene, case.transfers, Q_START, UNIT, options=OPTIONS)
    plan = plan_task(case.scene, case.transfers, Q_START, UNIT, options=OPTIONS, skip=True)
    assert sorted(cube["cube"] for cube in plan.task["cubes"]) == ["cube 1", "cube 3"]
    (stays,) = plan.task["skipped"]
    assert (stays["cube"], stays["from"]) == ("cube 2", case.transfers[1].pick.name)
    assert "post" in stays["reason"]
    scene = scene_from_json(plan.scene, case.scene.robot_open, case.scene.robot_holding)
    assert len(replay(plan, scene, UNIT, UNIT.limits())) == len(list(plan.moves))


def test_a_task_of_which_nothing_would_be_left_is_refused() -> None:
    case = fenced()
    with pytest.raises(ImpossibleError, match="cube 2"):
        plan_task(case.scene, case.transfers[1:2], Q_START, UNIT, options=OPTIONS, skip=True)


@pytest.mark.slow
def test_with_fewer_places_than_cubes_the_fastest_choice_moves() -> None:
    case = task2(cubes=4)
    first, *others = case.transfers
    transfers = [
        first,
        *(replace(t, place=place.place) for t, place in zip(others, (*others[:2], first), strict=True)),
    ]
    plan = plan_task(case.scene, transfers, Q_START, UNIT, options=OPTIONS, skip=True)
    assert len(plan.task["cubes"]) == 3
    (stays,) = plan.task["skipped"]
    assert stays["reason"] == "only 3 places are free and in reach"
    places = tuple(t.place for t in case.transfers[:3])
    for left_out in case.transfers:  # no other choice of three is faster
        rest = [t for t in case.transfers if t is not left_out]
        asked = [replace(t, place=place) for t, place in zip(rest, places, strict=True)]
        other = plan_task(case.scene, asked, Q_START, UNIT, options=OPTIONS)
        assert plan.duration_s <= 1.01 * other.duration_s


@pytest.mark.parametrize(("assignment", "skip"), [("free", False), ("given", False), ("given", True)])
def test_two_cubes_have_one_place_only_if_one_may_stay_and_any_may_go(assignment: str, skip: bool) -> None:
    case, options = task2(cubes=2), replace(OPTIONS, assignment=assignment)
    alike = [replace(transfer, place=case.transfers[0].place) for transfer in case.transfers]
    with pytest.raises(InputError, match="two transfers name the same place"):
        plan_task(case.scene, alike, Q_START, UNIT, options=options, skip=skip)


def lidded(case: Task2, *names: str) -> Task2:
    """A lid over each of these places."""
    places = {s.name: s for t in case.transfers for s in (t.pick, t.place)}
    lids = []
    for name in names:
        x, y, z = places[name].T_base_tool[0][:3, 3]
        lids.append(Body(f"lid {name}", Box((0.06, 0.06, 0.01)), transform(t=(x, y, z + 0.07)), "lid"))
    return replace(case, scene=replace(case.scene, bodies=(*case.scene.bodies, *lids)))


def test_the_place_of_a_cube_that_is_blocked_goes_to_one_that_had_none() -> None:
    case = task2(cubes=4)
    three = [replace(t, place=case.transfers[i % 3].place) for i, t in enumerate(case.transfers)]
    case = lidded(case, case.transfers[0].pick.name)
    plan = plan_task(case.scene, three, Q_START, UNIT, options=OPTIONS, skip=True)
    assert sorted(cube["cube"] for cube in plan.task["cubes"]) == ["cube 2", "cube 3", "cube 4"]
    (stays,) = plan.task["skipped"]
    assert stays["cube"] == "cube 1"
    assert "lid" in stays["reason"]


@pytest.mark.few(1)
@pytest.mark.parametrize("assignment", ["free", "given"])
def test_a_place_that_is_blocked_stays_empty_and_one_cube_where_it_is(assignment: str) -> None:
    case = task2(cubes=3)
    case, options = lidded(case, case.transfers[0].place.name), replace(OPTIONS, assignment=assignment)
    with pytest.raises(ImpossibleError, match="lid"):
        plan_task(case.scene, case.transfers, Q_START, UNIT, options=options)
    plan = plan_task(case.scene, case.transfers, Q_START, UNIT, options=options, skip=True)
    assert len(plan.task["cubes"]) == 2
    (stays,) = plan.task["skipped"]
    reason = "only 2 places are free and in reach" if assignment == "free" else "lid"
    assert reason in stays["reason"]


def test_a_cube_that_was_brought_can_be_brought_back() -> None:
    """The second task finds it where the first has put it."""
    case = task2(cubes=1)
    (there,) = case.transfers
    back = Transfer(there.cube, there.place, there.pick)
    program = Program(case.scene, (Transfers((there,)), Transfers((back,))), Q_START, UNIT, options=OPTIONS)
    plan = plan_program(program).plan()
    scene = scene_from_json(plan.scene, case.scene.robot_open, case.scene.robot_holding)
    assert len(replay(plan, scene, UNIT, UNIT.limits())) == len(list(plan.moves))
    at = placed_cubes(plan, scene, UNIT)[there.cube]
    assert np.abs(at - scene.cube(there.cube).T_base_body).max() < 1e-3


@pytest.mark.parametrize("assignment", ["free", "given"])
def test_a_cube_out_of_reach_is_named(assignment: str) -> None:
    case, options = task2(cubes=2), replace(OPTIONS, assignment=assignment)
    first, second = case.transfers
    away = transform(t=(0.0, 0.0, 1.5))
    pick = replace(first.pick, T_base_tool=tuple(frozen(away @ T) for T in first.pick.T_base_tool))
    cubes = tuple(c.at(frozen(away @ c.T_base_body)) if c.name == first.cube else c for c in case.scene.cubes)
    case = Task2(replace(case.scene, cubes=cubes), (replace(first, pick=pick), second))
    with pytest.raises(ImpossibleError, match=f"out of reach: hole {pick.name}: "):
        planner_of(case, options).search()
    plan = plan_task(case.scene, case.transfers, Q_START, UNIT, options=options, skip=True)
    (stays,) = plan.task["skipped"]
    assert (stays["cube"], stays["from"]) == (first.cube, pick.name)


@pytest.mark.parametrize("bound", [12.3456, 12.3454, 12.0])
def test_a_plan_states_no_more_than_its_bound_and_what_ended_its_search(bound: float) -> None:
    planner = planner_of(task2(cubes=1), OPTIONS)
    search = planner.search()
    found = replace(search.best(), bound=bound)
    stops = (None, KeyboardInterrupt(), BudgetSpent("effort", 2.0, 2.0))
    for stop, search.stopped in zip(stops, stops, strict=True):
        planned = planner._result(search, found, [])
        assert bound - 1e-3 < planned.lower_bound_s <= bound
        assert planned.interrupted == isinstance(stop, KeyboardInterrupt)
        assert bool(planned.stopped) == (stop is not None)
