"""What the cell asks the planner for: which cubes, which places, in which order, and how often to look."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.plan_file import LookStep, Plan
from arm.se3 import frozen, inverse, rot_z, transform
from cell.files.task import TablePlaces, Task, read_task
from cell.scene.build import build_scene
from cell.scene.displaced import DisplacedCube
from cell.scene.places import nothing_to_plan, reach_of, reachable_places
from cell.task.plan_matches import check_plan
from cell.task.planning import (
    NARROW,
    Rest,
    free_goals,
    plan_motion,
    plan_otherwise,
    plan_recovery,
    plan_rest,
    request_of,
    require_above_table,
    skipped_cubes,
)
from plan.advice.changes import Request
from plan.scene import scene_from_json
from plan.verify import replay
from tasks.seen_cells import planned
from tasks.true_look import true_look
from timed.relative import cost_s, interpreted
from vision.observation import Observation
from vision.occupancy.classify import FAINT, OTHER, Occupancy


def _request(task: Task, seen: Observation) -> Request:
    return request_of(Rest(task, seen, task.cell.q_start, 0.5))


@pytest.fixture(scope="module")
def task1() -> Task:
    return read_task(data_file("scenes/task1.toml"))


@pytest.fixture(scope="module")
def task2() -> Task:
    return read_task(data_file("scenes/task2.toml"))


@pytest.fixture(scope="module")
def whole1(task1: Task) -> tuple[Plan, dict[str, str]]:
    """The first task's plan, and where each cube goes in it."""
    return planned(task1)


@pytest.mark.slow
def test_places_on_the_table_are_chosen_for_time_unless_they_are_given(
    task1: Task, whole1: tuple[Plan, dict[str, str]]
) -> None:
    given = replace(task1, order="given", assignment="given")
    (free_plan, free), (given_plan, first) = whole1, planned(given)
    in_reach = [s.name for s in reachable_places(task1, true_look(task1))]
    assert list(first.items()) == [(f"cube 01-02/{i + 1}", in_reach[i]) for i in range(4)]
    assert set(free) == set(first)
    assert len(set(free.values())) == 4
    assert set(free.values()) <= set(in_reach)
    assert free_plan.duration_s < 0.95 * given_plan.duration_s
    for task, plan in ((task1, free_plan), (given, given_plan)):
        assert check_plan(task, plan)["holds"]


@pytest.mark.parametrize("speed", [0.001, 0.01, 1.0])
def test_reach_and_plan_name_the_same_best_branches(task2: Task, speed: float) -> None:
    """Same table, same ranking, whatever the speed: joints keep up with lines or do not."""
    seen = true_look(task2)
    told = reach_of(task2, seen, speed)
    request = request_of(Rest(task2, seen, task2.cell.q_start, speed))
    for hole in request.reach(request.stations()).holes:
        mine = told[hole.hole]
        assert [(c.yaw, c.branch, c.margin, c.ok) for c in hole.choices] == [
            (c.yaw, c.branch, c.margin, c.ok) for c in mine.choices
        ]


def test_holes_below_the_table_are_told(task2: Task) -> None:
    seen = true_look(task2)
    lowest = min(float(h.T_base_hole[2, 3]) for p in seen.poses for h in p.holes)
    assert require_above_table(task2, seen) is None
    high = replace(task2, cell=replace(task2.cell, table_z=lowest + 0.0123))
    with pytest.raises(
        ImpossibleError, match=r"below the table's top, .* by 12.3 mm.*table.top_z_mm = "
    ) as caught:
        plan_rest(Rest(high, seen, high.cell.q_start, 0.5))
    assert max(caught.value.data["below_mm"].values()) == pytest.approx(12.3)


@pytest.mark.slow
def test_what_was_moved_stays_where_it_is(task1: Task, whole1: tuple[Plan, dict[str, str]]) -> None:
    whole, goes = whole1
    cube = whole.task["cubes"][0]["cube"]
    seen = true_look(task1).with_moves({cube: goes[cube]})
    rest, left = planned(task1, seen, {cube: goes[cube]})
    assert set(left) == set(goes) - {cube}
    assert goes[cube] not in left.values()
    assert rest.duration_s < whole.duration_s
    assert check_plan(task1, rest)["holds"]


def test_only_free_holes_are_filled(task2: Task) -> None:
    states = {"01-02/1": "empty", "01-02/3": "empty", "03-04/2": "cube", "03-04/3": "unsure"}
    seen = true_look(task2).with_states(states)
    request = _request(task2, seen)
    assert [t.cube for t in request.transfers] == ["cube 01-02/2", "cube 01-02/4"]
    assert not request.places
    _, goes = planned(task2, seen)
    assert set(goes) == {"cube 01-02/2", "cube 01-02/4"}
    assert set(goes.values()) == {"03-04/1", "03-04/4"}
    one = seen.with_states({"01-02/1": "cube", "01-02/2": "empty", "01-02/4": "empty"})
    assert [s.name for s in _request(task2, one).places] == ["03-04/4"]


def test_a_motion_to_the_start_keeps_its_clearance_with_errors(task2: Task) -> None:
    calibrated = read_task(data_file("scenes/realistic/task2.toml"))
    seen = true_look(calibrated)
    q = calibrated.cell.q_start + np.radians([60.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    scene, q_start = build_scene(calibrated.cell, seen), calibrated.cell.q_start
    assert plan_motion(calibrated, scene, q, q_start, 0.5) is not None
    erring = replace(calibrated, cell=replace(calibrated.cell, following_error=np.radians(1.0)))
    with pytest.raises(ImpossibleError, match="for all errors of the arm within 3 standard deviations"):
        plan_motion(erring, scene, q, q_start, 0.5)


def test_only_the_holes_that_the_task_file_names_are_filled(task2: Task) -> None:
    seen = true_look(task2).with_states({"01-02/1": "empty", "01-02/3": "empty"})
    chosen = replace(task2, to_holes=(2, 4))
    request = _request(chosen, seen)
    assert {t.place.name for t in request.transfers} == {"03-04/2", "03-04/4"}
    assert not request.places
    assert {h.hole for h in reach_of(chosen, seen).holes if h.hole.startswith("03")} == {"03-04/2", "03-04/4"}
    with pytest.raises(
        ImpossibleError, match=r"\(hole 03-04/1 is not one of to_holes; hole 03-04/2 is not one"
    ):
        _request(replace(task2, to_holes=(3,)), seen)
    other = plan_otherwise(
        Rest(chosen, seen, task2.cell.q_start, 0.5), seen.with_states({"01-02/4": "empty"}), {"03-04/2"}
    )
    assert [(c["cube"], c["to"]) for c in other.task["cubes"]] == [("cube 01-02/2", "03-04/4")]
    with pytest.raises(ImpossibleError, match="no cube: there is nothing to plan"):
        plan_otherwise(
            Rest(chosen, seen, task2.cell.q_start, 0.5, done={"cube 01-02/2": "", "cube 01-02/4": ""}),
            seen,
            set(),
        )


def test_a_hole_that_is_unsure_is_no_place_and_says_why(task2: Task) -> None:
    seen = true_look(task2)
    source, target = seen.boards
    unsure = Occupancy("unsure", reason="poor contrast")
    doubtful = replace(target, occupancy=(unsure, *target.occupancy[1:]))
    with pytest.raises(
        ImpossibleError,
        match=r"hole 03-04/1 may hold a cube; it is unsure \(poor contrast\).*let the camera see the unsure holes",
    ):
        _request(task2, replace(seen, boards=(source, doubtful)))


@pytest.mark.slow
def test_a_table_full_of_places_is_planned_in_reasonable_time(
    task1: Task, whole1: tuple[Plan, dict[str, str]]
) -> None:
    x, y = np.meshgrid(0.2 + 0.062 * np.arange(10), -0.6 + 0.062 * np.arange(20))
    many = TablePlaces(tuple(zip(x.ravel().tolist(), y.ravel().tolist(), strict=True)), 0.0)
    few, _ = whole1
    made = []
    assert cost_s(lambda: made.append(planned(replace(task1, places=many)))) <= 2000.0 * cost_s(interpreted)
    ((plan, goes),) = made
    assert len(set(goes.values())) == 4
    assert plan.duration_s < few.duration_s


def test_no_cube_is_taken_from_a_hole_that_shows_something_else(task2: Task) -> None:
    seen = true_look(task2)
    name = task2.from_board.name
    for doubt, refused in ((OTHER, True), ("something leans there", True), (FAINT, False), ("", False)):
        boards = tuple(
            replace(b, occupancy=(Occupancy("unsure", reason=doubt), *b.occupancy[1:]))
            if b.name == name
            else b
            for b in seen.boards
        )
        after = replace(seen, boards=boards)
        if refused:
            with pytest.raises(
                ImpossibleError, match=f"no cube can be taken from hole {name}/1: {doubt}; seat the cube"
            ):
                _request(task2, after)
        else:
            assert len(_request(task2, after).transfers) == 4


def test_a_doubtful_cube_stays_if_the_task_file_says_so(task2: Task) -> None:
    seen = true_look(task2)
    source = seen.board(task2.from_board.name)
    assert source is not None
    doubtful = replace(source.occupancy[1], state="unsure", reason=OTHER)
    changed = replace(source, occupancy=(source.occupancy[0], doubtful, *source.occupancy[2:]))
    seen = replace(seen, boards=tuple(changed if b is source else b for b in seen.boards))
    with pytest.raises(ImpossibleError, match="no cube can be taken from hole 01-02/2"):
        _request(task2, seen)
    plan = plan_rest(Rest(replace(task2, skip=True), seen, task2.cell.q_start, 0.5))
    assert plan is not None
    assert len(plan.task["cubes"]) == 3
    (line,) = skipped_cubes(plan)
    assert line.startswith("cube 01-02/2 stays in 01-02/2: no cube can be taken from hole 01-02/2: ")
    assert skipped_cubes(None) == []


@pytest.mark.parametrize("assignment", ["free", "given"])
def test_three_of_four_cubes_move_if_there_are_three_places(task2: Task, assignment: str) -> None:
    seen = true_look(task2)
    target = seen.board(task2.to_board.name) if task2.to_board else None
    assert target is not None
    filled = replace(target, occupancy=(replace(target.occupancy[0], state="cube"), *target.occupancy[1:]))
    seen = replace(seen, boards=tuple(filled if b is target else b for b in seen.boards))
    task = replace(task2, assignment=assignment)
    with pytest.raises(ImpossibleError, match="4 cubes to move but only 3 free and reachable places"):
        _request(task, seen)
    plan = plan_rest(Rest(replace(task, skip=True), seen, task.cell.q_start, 0.5))
    assert plan is not None
    assert len({cube["to"] for cube in plan.task["cubes"]}) == 3
    (line,) = skipped_cubes(plan)
    assert line.endswith("only 3 places are free and in reach")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("away", "least", "most", "touches"),
    [
        (0.026, 5e-3, 1.0, ()),
        (0.032, NARROW, 5e-3, ()),
        (0.0355, NARROW, 1.0, ("cube 03-04/1",)),
    ],
)
def test_a_cube_too_close_to_another_is_lifted_with_less_room(
    task2: Task, away: float, least: float, most: float, touches: tuple[str, ...]
) -> None:
    """All lines keep 5 mm, unless the cube stands with a corner nearer than that to a seated one.

    From beside one that is 6 mm away, as far as boards may move unnoticed, it is lifted along that cube.
    """
    seen = true_look(task2).with_states({"03-04/1": "cube", "01-02/4": "empty", "01-02/3": "empty"})
    board = seen.board("03-04")
    assert board is not None
    T, other = (board.pose.holes[i].T_base_hole for i in (1, 0))
    towards = (inverse(T) @ other)[:2, 3]
    at = transform(rot_z(np.radians(44.0)), (*away * towards / np.hypot(*towards), 0.020))
    cube = DisplacedCube("cube 01-02/3", "03-04/2", frozen(mul(T, at)))
    rest = Rest(task2, seen, task2.cell.q_start, 0.5, displaced=(cube,))
    plan = plan_recovery(rest, cube, free_goals(rest))
    assert least <= min(move.clearance for move in plan.moves) < most
    for move in plan.moves:
        lifts = move.held is not None and move.role == "retract"
        assert set(move.allowed_collisions) - {"plate 03-04"} == (set(touches) if lifts else set())
    scene = scene_from_json(plan.scene, task2.cell.robot(), task2.cell.robot_holding())
    assert len(replay(plan, scene, task2.cell.unit, task2.cell.limits)) == sum(1 for _ in plan.moves)


def test_a_recovery_that_the_errors_of_the_arm_refuse_is_planned_in_another_way(
    task2: Task, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = true_look(task2).with_states({"01-02/4": "empty"})
    cube = _aside(seen, "cube 01-02/4", "01-02/4", 0.026)
    rest, made = Rest(task2, seen, task2.cell.q_start, 0.5, displaced=(cube,)), list[Plan]()

    def too_near(cell: object, plan: Plan, look: Observation) -> None:
        made.append(plan)
        if len(made) < 3:
            raise ImpossibleError("too near for all errors")

    monkeypatch.setattr("cell.task.planning.erring_clearances", too_near)
    plan = plan_recovery(rest, cube, free_goals(rest))
    assert [one.sha256 for one in made].index(plan.sha256) == 2


def _aside(seen: Observation, name: str, near: str, away: float) -> DisplacedCube:
    """A cube that stands flat on a plate, `away` m from a hole, towards the middle of the board's other long side."""
    board, number = near.split("/")
    found = seen.board(board)
    assert found is not None
    T = mul(found.pose.holes[int(number) - 1].T_base_hole, transform(t=(away, 0.0, 0.020)))
    return DisplacedCube(name, near, frozen(T))


def test_no_cube_is_put_beside_a_displaced_one_and_the_others_go_on(task2: Task) -> None:
    """It keeps a hole from being filled; the cube for which no place is left stays, and the plan says so."""
    seen = true_look(task2).with_states({"01-02/4": "empty"})
    stays = _aside(seen, "cube 01-02/4", "03-04/1", 0.030)
    for displaced, free in (((), 4), ((stays,), 3), ((replace(stays, T_base_cube=transform()),), 4)):
        rest = Rest(task2, seen, task2.cell.q_start, 0.5, displaced=displaced)
        assert len(free_goals(rest)) == free
    full = seen.with_states({"03-04/3": "cube"})
    for assignment in ("free", "given"):
        task = replace(task2, assignment=assignment)
        plan = plan_rest(Rest(task, full, task.cell.q_start, 0.5, displaced=(stays,)))
        assert plan is not None
        assert len(plan.task["cubes"]) == 2
        assert len(skipped_cubes(plan)) == 1


def test_a_cube_in_the_hole_beside_a_displaced_one_is_in_the_scene(task2: Task) -> None:
    """A leaning cube may look like one in its hole; one that stands far enough aside is another."""
    seen = true_look(task2).with_states({"01-02/4": "empty", "03-04/1": "cube"})
    for away, both in ((0.003, False), (0.045, True)):
        cube = _aside(seen, "cube 01-02/4", "03-04/1", away)
        names = {c.name for c in Rest(task2, seen, task2.cell.q_start, 0.5, displaced=(cube,)).scene.cubes}
        assert cube.name in names
        assert ("cube 03-04/1" in names) is both


def test_second_looks_are_planned_where_they_are_asked_for(task1: Task, task2: Task) -> None:
    """The arm rests with the cube 10 mm above the plate; without a look nothing is different."""
    seen, asked = true_look(task2), frozenset(("cube 01-02/2", "cube 01-02/3"))
    for when, wanted in (
        ("asked", asked),
        ("never", set()),
        ("each", {f"cube 01-02/{n}" for n in (1, 2, 3, 4)}),
    ):
        task = replace(task2, cell=replace(task2.cell, second_look=when))
        rest = Rest(task, seen, task.cell.q_start, 0.5, second_looks=asked)
        looking = {t.cube: t.look_before for t in request_of(rest).transfers if t.look_before}
        assert set(looking) == wanted
        assert all(before == pytest.approx(0.017) for before in looking.values())
    assert not any(t.look_before for t in _request(task2, seen).transfers)
    on_table = replace(task1, cell=replace(task1.cell, second_look="each"))
    assert not any(t.look_before for t in _request(on_table, true_look(task1)).transfers)


def test_a_cube_that_is_taken_from_its_target_board_asks_for_a_second_look() -> None:
    """The jaws may have moved that board. Without a calibration no budget says what that matters."""
    for name, looks in (("realistic/task2", True), ("task2", False)):
        task = read_task(data_file(f"scenes/{name}.toml"))
        seen = true_look(task)
        (goal,) = (s for s in free_goals(Rest(task, seen, task.cell.q_start, 0.5)) if s.name == "03-04/1")
        for near, there in (("03-04/1", looks), ("01-02/2", False)):
            board, number = near.split("/")
            hole = next(b for b in seen.boards if b.name == board).pose.holes[int(number) - 1]
            T = frozen(mul(hole.T_base_hole, transform(t=(0.0, 0.0, 0.02))))
            cube = DisplacedCube("cube 01-02/2", near, T)
            empty = seen.with_states({"01-02/2": "empty"})
            plan = plan_recovery(Rest(task, empty, task.cell.q_start, 0.5, displaced=(cube,)), cube, (goal,))
            assert [s.cube for s in plan.steps if isinstance(s, LookStep)][:1] == ([0] if there else [None])


def test_places_that_cannot_be_used_are_told_with_what_takes_them(task1: Task) -> None:
    seen = true_look(task1)
    assert task1.places is not None
    x, y = seen.poses[0].T_base_board[:2, 3]
    under, far = [(float(x) + 0.01 * n, float(y)) for n in range(2)], [(1.5, 0.0)]
    task = replace(task1, places=TablePlaces((*task1.places.centres[:1], *under, *far), 0.0))
    with pytest.raises(ImpossibleError) as refused:
        _request(task, seen)
    assert str(refused.value) == (
        "4 cubes to move but only 1 free and reachable places of 4: 2 under or too near to board 01-02, 1 out of "
        "reach; places.origin_mm in task1.toml moves them away from board 01-02 and into reach, places.count gives more"
    )
    task = replace(task1, places=TablePlaces(task1.places.centres[:2], 0.0))
    with pytest.raises(ImpossibleError, match=r"places of 2: 1 with a cube; places.count gives more"):
        request_of(Rest(task, seen, task.cell.q_start, 0.5, done={"cube 01-02/1": "table/1"}))


def test_boards_that_may_be_swapped_are_told(task2: Task) -> None:
    assert task2.to_board is not None
    swapped = replace(task2, from_board=task2.to_board, to_board=task2.from_board)
    seen = true_look(task2)
    assert str(nothing_to_plan(swapped, seen)) == (
        "board 03-04 holds no cube: there is nothing to plan (from_board = [3, 4]; board 01-02, the to_board, holds 4: "
        "is the task done, or are they swapped in task2.toml?)"
    )
    with pytest.raises(ImpossibleError, match="are they swapped"):
        plan_otherwise(Rest(swapped, seen, task2.cell.q_start, 0.5), seen, set())
    empty = seen.with_states({f"01-02/{n}": "empty" for n in range(1, 5)})
    assert str(nothing_to_plan(swapped, empty)) == "board 03-04 holds no cube: there is nothing to plan"
