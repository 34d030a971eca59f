"""Motions from where a run could not go on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import load_unit
from arm.errors import ImpossibleError
from arm.plan_file import GripperStep, Plan, touching_pairs
from arm.robot.shapes import Body, Box
from arm.se3 import frozen, inverse, transform
from plan.cartesian.reachability import reach
from plan.collision.certificate import certify_move
from plan.collision.world import World
from plan.options import PlanOptions
from plan.program import recovery
from plan.program.program import Program
from plan.program.recovery import (
    BESIDE,
    CarryPlanner,
    InJaws,
    plan_retreat,
)
from plan.program.setting import Setting
from plan.scene import Station, scene_from_json
from plan.trajectory.extremes import segment_extremes
from plan.verify import scenes_of_moves
from tasks.task2 import CUBE, JAW_OPENING, Q_START, Task2, task2

UNIT = load_unit("crs93")

OPTIONS = PlanOptions()


@pytest.fixture(scope="module")
def case() -> Task2:
    return task2()


@pytest.fixture(scope="module")
def q_place(case: Task2) -> np.ndarray:
    """Where the jaws stand around cube 2."""
    station = case.transfers[1].pick
    table = reach(case.scene.robot_open, UNIT.limits(), {station.name: station.T_base_tool}, OPTIONS.offset)
    return UNIT.positions(UNIT.counts(table[station.name].feasible()[0].q_hole))


def test_straight_out_and_from_rest_to_rest(case: Task2, q_place: np.ndarray) -> None:
    (move,) = plan_retreat(case.scene, q_place, UNIT, UNIT.limits(), OPTIONS)
    assert move.path.start == tuple(UNIT.counts(q_place))
    for velocity in (move.path.segments[0].derivative(0.0), move.path.segments[-1].derivative(1.0)):
        assert np.abs(velocity).max() == 0.0
    place = inverse(case.scene.robot_open.T_base_tool(q_place))
    relative = [place @ case.scene.robot_open.T_base_tool(q) for q in UNIT.positions(move.path.sample(0.01))]
    assert max(np.hypot(T[0, 3], T[1, 3]) for T in relative) < 1e-4
    assert relative[-1][2, 3] == pytest.approx(-OPTIONS.offset, abs=1e-4)
    found, allowed = segment_extremes(move.path, UNIT), UNIT.limits().scaled(OPTIONS.speed)
    assert (found.velocity <= allowed.velocity).all()
    assert (found.acceleration <= allowed.acceleration).all()
    assert move.certified
    assert move.jaw_opening == JAW_OPENING
    assert (move.role, move.held) == ("retract", None)
    assert move.clearance >= 0.0045


def test_an_obstacle_is_named(case: Task2, q_place: np.ndarray) -> None:
    T = case.scene.robot_open.T_base_tool(q_place)
    beside = (T @ transform(t=(0.0, 0.07, -0.17)))[:3, 3]
    box = Body("box", Box((0.05, 0.05, 0.05)), transform(t=beside), "box")
    scene = replace(case.scene, bodies=(*case.scene.bodies, box))
    with pytest.raises(ImpossibleError, match=r"'the place of the jaws'.* from box") as refused:
        plan_retreat(scene, q_place, UNIT, UNIT.limits(), OPTIONS)
    assert "box" in refused.value.data["pair"]


def half_out(case: Task2, share: float) -> tuple[np.ndarray, InJaws]:
    """Cube 2 in the jaws, drawn out of its hole by a share of the line."""
    station, cube = case.transfers[1].pick, case.scene.cube(case.transfers[1].cube)
    table = reach(case.scene.robot_open, UNIT.limits(), {station.name: station.T_base_tool}, OPTIONS.offset)
    grasp = table[station.name].feasible()[0]
    T_tool_cube = inverse(case.scene.robot_open.T_base_tool(grasp.q_hole)) @ cube.T_base_body
    q = grasp.q_line[round(share * (len(grasp.q_line) - 1))]
    return UNIT.positions(UNIT.counts(q)), InJaws(cube.name, frozen(T_tool_cube), station.touches)


def planner(case: Task2, q: np.ndarray, held: InJaws) -> CarryPlanner:
    return CarryPlanner(Setting(case.scene, UNIT, UNIT.limits(), OPTIONS), q, held, Q_START)


def test_a_cube_half_in_its_hole_is_drawn_out_carried_and_released(case: Task2) -> None:
    """Each move is certified again in a world that is made from what is known: where the cube is at each time."""
    q, held = half_out(case, 0.1)
    place = case.transfers[1].place
    plan = planner(case, q, held).to_place(place)
    moves = list(plan.moves)
    assert [m.role for m in moves] == ["retract", "transit", "approach", "retract", "home"]
    assert [m.held for m in moves] == [held.cube] * 3 + [None] * 2
    assert plan.start == tuple(UNIT.counts(q))
    release = next(i for i, s in enumerate(plan.steps) if isinstance(s, GripperStep))
    assert (plan.steps[release].action, plan.steps[release - 1]) == ("open", moves[2])
    others = [c for c in case.scene.cubes if c.name != held.cube]
    cube = case.scene.cube(held.cube)
    at = case.scene.robot_open.T_base_tool(UNIT.positions(moves[2].path.end))
    assert min(np.abs(T - at).max() for T in place.T_base_tool) < 1e-4
    for move in moves:
        allowed = touching_pairs(move)
        if move.held:
            world = World(
                case.scene.robot_holding, [*case.scene.bodies, *others], cube, held.T_tool_cube, allowed
            )
        else:
            bodies = [*case.scene.bodies, *others, cube.at(at @ held.T_tool_cube)]
            world = World(case.scene.robot_open, bodies, allowed=allowed)
        assert move.jaw_opening == (CUBE if move.held else JAW_OPENING)
        on_line = move.role in ("approach", "retract")
        assert move.clearance >= (OPTIONS.line_clearance - BESIDE if on_line else OPTIONS.clearance) - 1e-6
        assert certify_move(world, move.path, UNIT, move.clearance - 1e-6).proved


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[Program]:
    """Programs that recovery asks for; each is refused."""
    found: list[Program] = []

    def refuse(program: Program) -> None:
        found.append(program)
        raise ImpossibleError("refused")

    monkeypatch.setattr(recovery, "plan_program", refuse)
    return found


@pytest.mark.parametrize(("share", "way_out"), [(0.0, True), (0.1, True), (1.0, False)])
def test_the_way_out_is_as_clear_as_lines_and_may_be_shorter(
    case: Task2, asked: list[Program], share: float, way_out: bool
) -> None:
    q, held = half_out(case, share)
    with pytest.raises(ImpossibleError, match=f"{held.cube}, which is in the jaws, cannot be brought to"):
        planner(case, q, held).to_place(case.transfers[1].place)
    assert [len(program.goals) for program in asked] == ([3, 3, 3] if way_out else [2])
    if way_out:
        lengths = [program.goals[0].retract / OPTIONS.offset for program in asked]
        assert lengths == pytest.approx([1.0, 0.6, 0.3])
        assert {program.goals[0].line_clearance for program in asked} == {OPTIONS.line_clearance - BESIDE}
    at = case.scene.robot_open.T_base_tool(q) @ held.T_tool_cube
    for program in asked:
        assert sorted(c.name for c in program.scene.cubes) == sorted(c.name for c in case.scene.cubes)
        np.testing.assert_allclose(program.scene.cube(held.cube).T_base_body, at, atol=1e-12)


def test_a_cube_that_nearly_touches_is_drawn_out_first(case: Task2, asked: list[Program]) -> None:
    """Above its hole, with more than nothing and less than the clearance of transits."""
    shares = np.linspace(0.1, 0.4, 10)
    others = [c for c in case.scene.cubes if c.name != case.transfers[1].cube]
    near = 0
    for share in shares:
        q, held = half_out(case, share)
        world = World(
            case.scene.robot_holding,
            [*case.scene.bodies, *others],
            case.scene.cube(held.cube),
            held.T_tool_cube,
        )
        if 0.0 < world.distance(q).value < OPTIONS.clearance:
            near += 1
            asked.clear()
            with pytest.raises(ImpossibleError):
                planner(case, q, held).to_place(case.transfers[1].place)
            assert len(asked) == 3
    assert near


def test_the_retreat_is_as_clear_as_lines(case: Task2, q_place: np.ndarray, asked: list[Program]) -> None:
    with pytest.raises(ImpossibleError, match="refused"):
        plan_retreat(case.scene, q_place, UNIT, UNIT.limits(), OPTIONS)
    (goal,) = asked[0].goals
    assert (goal.retract, goal.line_clearance) == (OPTIONS.offset, OPTIONS.line_clearance - BESIDE)


def above_place(case: Task2, before: float) -> tuple[np.ndarray, InJaws, Station]:
    """Cube 2 in the jaws, `before` m from its place; the place has the one pose of its release there."""
    _, held = half_out(case, 1.0)
    place = case.transfers[1].place
    table = reach(case.scene.robot_open, UNIT.limits(), {place.name: place.T_base_tool}, OPTIONS.offset)
    grasp = table[place.name].feasible()[0]
    q = grasp.q_line[round(before / OPTIONS.offset * (len(grasp.q_line) - 1))]
    release = case.scene.robot_open.T_base_tool(grasp.q_hole)
    held = InJaws(held.cube, held.T_tool_cube, place.touches)
    return UNIT.positions(UNIT.counts(q)), held, replace(place, T_base_tool=(release,))


def _require_proved(case: Task2, plan: Plan, held: InJaws) -> None:
    scene = scene_from_json(plan.scene, case.scene.robot_open, case.scene.robot_holding)
    for of in scenes_of_moves(plan, scene, UNIT, held.cube):
        assert certify_move(of.world(), of.move.path, UNIT, of.move.clearance - 1e-6).proved


@pytest.mark.parametrize("aside", [(0.0, 0.0), (0.003, -0.002)])
def test_the_last_part_leads_straight_to_where_the_place_is_now(
    case: Task2, aside: tuple[float, float]
) -> None:
    """Beside the new place first, and then in along the tool: never sideways while the cube is in the pocket."""
    q, held, place = above_place(case, 0.02)
    (before,) = place.T_base_tool
    now = frozen(before @ transform(t=(*aside, 0.0)))
    place = replace(place, T_base_tool=(now,))
    robot = case.scene.robot_open
    plan = planner(case, q, held).last_part(place, 0.015)
    roles = [m.role for m in plan.moves]
    assert roles == ["line", "approach", "retract", "home"]
    line, approach, *_ = plan.moves
    assert plan.start == tuple(UNIT.counts(q))
    np.testing.assert_allclose(robot.T_base_tool(UNIT.positions(approach.path.end)), now, atol=5e-5)
    down = [inverse(now) @ robot.T_base_tool(p) for p in UNIT.positions(approach.path.sample(0.01))]
    assert max(np.hypot(T[0, 3], T[1, 3]) for T in down) < 1e-4
    assert down[0][2, 3] == pytest.approx(-0.015, abs=1e-4)
    over = [inverse(now) @ robot.T_base_tool(p) for p in UNIT.positions(line.path.sample(0.01))]
    assert max(T[2, 3] for T in over) < -0.0149
    _require_proved(case, plan, held)


def test_a_cube_is_taken_back_to_the_start_in_the_jaws(case: Task2) -> None:
    q, held, _ = above_place(case, 0.005)
    plan = planner(case, q, held).home()
    assert [(m.role, m.held) for m in plan.moves] == [("retract", held.cube), ("home", held.cube)]
    np.testing.assert_allclose(UNIT.positions(list(plan.moves)[-1].path.end), Q_START, atol=1e-4)
    _require_proved(case, plan, held)
