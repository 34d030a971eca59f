"""Clearances of an arm with its errors: of every move of a plan, and required."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import Plan, touching_pairs, write_plan
from arm.robot.shapes import Body
from arm.se3 import Array, transform
from cell.accuracy import clearances
from cell.accuracy.arm_errors import arm_errors, body_errors
from cell.accuracy.clearances import erring_clearances
from cell.files.task import Task, read_task
from cell.program.planning import plan_of_program
from cell.program.program_file import ProgramTask, read_program
from cell.task.plan_matches import check_plan
from cell.task.planning import Rest, plan_rest
from plan.collision.world import World
from plan.scene import scene_from_json
from plan.verify import scenes_of_moves
from programs.pallets import pallet
from tasks.true_look import true_look
from typed.command_line import ended
from vision.observation import Observation


@pytest.mark.slow
def test_every_move_has_a_clearance_with_errors(task: Task, plan: Plan) -> None:
    found = erring_clearances(task.cell, plan)
    moves = list(plan.moves)
    assert len(found) == len(moves)
    lost = [1e3 * (move.clearance - of) for move, of in zip(moves, found, strict=True)]
    lines = [one for move, one in zip(moves, lost, strict=True) if move.role in ("approach", "retract")]
    assert all(0.3 < one < 2.0 for one in lines)
    exact = [m["proved_erring_mm"] for m in check_plan(task, plan)["moves"]]
    assert all(1e3 * of <= proved + 0.05 * proved + 0.5 for of, proved in zip(found, exact, strict=True))


def test_a_plan_that_keeps_too_little_with_errors_is_refused(task: Task, plan: Plan) -> None:
    """The joints' error at rest grows until some move keeps less than is asked."""
    cell = replace(task.cell, following_error=np.radians(0.1), erring_clearance=2e-3)
    with pytest.raises(ImpossibleError, match=r"within 3 standard deviations.*lower it to") as refused:
        erring_clearances(cell, plan)
    data = refused.value.data
    assert data["clearance_mm"] < data["required_mm"] == 2.0
    assert data["step"] in {move.name for move in plan.moves}
    assert len(data["pair"]) == 2
    least = min(erring_clearances(replace(cell, erring_clearance=0.0), plan))
    assert 0.0 < least < 2e-3
    allowed = replace(cell, erring_clearance=least - 1e-4)
    assert len(erring_clearances(allowed, plan)) == len(list(plan.moves))


def test_a_line_that_keeps_too_little_is_told_what_acts_on_it(task: Task, plan: Plan) -> None:
    """Approach and retract of a task with cubes keep a clearance of their own; those of lists the cell's."""
    cell = replace(task.cell, erring_clearance=8e-3)
    with pytest.raises(
        ImpossibleError, match=r"approach or retract\), or calibrate the arm again"
    ) as refused:
        erring_clearances(cell, plan)
    lower = re.search(r"least_clearance_mm is 8; lower it to (\S+) or less \(motion", str(refused.value))
    assert lower is not None
    assert 0.0 <= refused.value.data["clearance_mm"] - float(lower[1]) < 0.1
    options = {**plan.provenance["options"], "line_clearance": cell.clearance, "look": "never"}
    of_list = replace(plan, provenance={**plan.provenance, "options": options})
    with pytest.raises(ImpossibleError, match=r"is 8; raise motion.clearance_mm by \d"):
        erring_clearances(cell, of_list)


def test_unknown_errors_are_not_checked(task: Task, plan: Plan) -> None:
    assert erring_clearances(replace(task.cell, sigmas=0.0), plan) == ()
    assert erring_clearances(replace(task.cell, calibration=None), plan) == ()


@pytest.mark.slow
def test_a_plan_is_not_executed_by_an_arm_that_errs_too_much(tmp_path: Path) -> None:
    """The search does not use the errors, so a plan of Python's may keep too little with them."""
    scenes = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "realistic"
    with (scenes / "cell.toml").open("a") as file:
        file.write("\n[accuracy]\nfollowing_deg = 0.1\nleast_clearance_mm = 2\n")
    task = read_task(scenes / "task2.toml")
    made = plan_rest(Rest(task, true_look(task), task.cell.q_start, 0.5))
    assert made is not None
    write_plan(tmp_path / "plan.json", made)
    code, said = ended("execute", tmp_path / "plan.json", task.file, cwd=tmp_path)
    assert code == 3
    assert "for all errors of the arm within 3 standard deviations" in said
    assert re.search(r"lower it to \d\.\d or less", said), said
    assert not (tmp_path / "runs").exists() or not list((tmp_path / "runs").rglob("wire.jsonl"))


def test_boards_and_cubes_take_off_what_they_may_be_off(task: Task, seen: Observation, plan: Plan) -> None:
    """Every move of arms, boards and cubes that err as much as is allowed for keeps what was proved."""
    cell, rng = task.cell, np.random.default_rng(4)
    noisy = replace(
        seen,
        boards=tuple(
            replace(b, pose=replace(b.pose, covariance=np.diag([2e-4, 2e-4, 4e-4, 2e-3, 2e-3, 2e-3]) ** 2))
            for b in seen.boards
        ),
    )
    alone, both = (erring_clearances(cell, plan, look) for look in (None, noisy))
    assert all(0.5e-3 < a - b < 6e-3 for a, b in zip(alone, both, strict=True))
    scene = scene_from_json(plan.scene, cell.robot(), cell.robot_holding())
    off = body_errors(cell, noisy, plan, scene)
    assert set(off) == {b.name for b in (*scene.bodies, *scene.cubes) if b.kind in ("board", "stand", "cube")}
    errors = arm_errors(cell)
    assert errors is not None
    root, gaps = np.linalg.cholesky(errors.covariance), []
    for of, proved in list(zip(scenes_of_moves(plan, scene, cell.unit), both, strict=True))[1:7]:
        for _ in range(4):
            way = rng.normal(size=6)
            q_off = errors.sigmas * root @ (way / np.linalg.norm(way))
            moved = {name: _shifted(by, rng) for name, by in off.items()}
            bodies = [_at(b, moved) for b in (*of.scene.bodies, *of.resting)]
            held, T_tool_held = of.held or (None, None)
            T_tool_held = None if held is None else T_tool_held @ transform(t=moved[held.name])
            world = World(of.robot, bodies, held, T_tool_held, touching_pairs(of.move))
            q = cell.unit.positions(of.move.path.sample(0.1))
            gaps.append(min(world.distance(here + q_off).value for here in q) - proved)
    assert min(gaps) > -1e-5
    assert min(gaps) < 5e-3


def test_a_cube_in_the_jaws_and_what_it_may_touch_both_take_off(
    task: Task, seen: Observation, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    cube = next(move.held for move in plan.moves if move.held is not None)
    found = []
    for off in (0.0, 1e-3):
        monkeypatch.setattr(
            clearances, "body_errors", lambda *_, off=off: {cube: off, "plate 01-02": 2.0 * off}
        )
        found.append(erring_clearances(task.cell, plan, seen))
    for move, before, after in zip(plan.moves, *found, strict=True):
        assert before - after == pytest.approx(3e-3 if move.held == cube else 2e-3, abs=1e-9)


def _shifted(by: float, rng: np.random.Generator) -> Array:
    way = rng.normal(size=3)
    return np.asarray(by * way / np.linalg.norm(way))


def _at(body: Body, moved: dict[str, Array]) -> Body:
    if body.name not in moved:
        return body
    return body.at(transform(t=moved[body.name]) @ body.T_base_body)


@pytest.fixture(scope="module")
def boxes(tmp_path_factory: pytest.TempPathFactory) -> tuple[ProgramTask, Plan]:
    """Two boxes beside each other, in a calibrated cell."""
    text = str(data_file("scenes/cell.toml")), str(data_file("scenes/realistic/cell.toml"))
    folder = tmp_path_factory.mktemp("boxes")
    task = read_program(
        pallet(folder, text, ("[1, 2, 2]", "[1, 2, 1]"), ("52, 36]", "58, 36]"), ("= 5\n", "= 7\n"))
    )
    return task, plan_of_program(task, Observation(), 0.5)


@pytest.mark.slow
def test_parts_may_be_off_by_the_arms_errors_where_it_takes_and_puts_them(
    boxes: tuple[ProgramTask, Plan],
) -> None:
    """Every move of an arm that errs otherwise at each grasp and release keeps what was proved."""
    task, plan = boxes
    cell, rng, gaps = task.cell, np.random.default_rng(6), list[float]()
    proved, errors = erring_clearances(cell, plan), arm_errors(cell)
    assert errors is not None
    scene = scene_from_json(plan.scene, cell.robot(), cell.robot_holding())
    moves = list(scenes_of_moves(plan, scene, cell.unit))
    root, robot = np.linalg.cholesky(errors.covariance), cell.robot()
    for _ in range(12):

        def erring(q: Array) -> Array:
            way = rng.normal(size=6)
            return np.asarray(q + errors.sigmas * root @ (way / np.linalg.norm(way)))

        at = {body.name: body.T_base_body for body in scene.cubes}
        held, T_tool_held = None, np.eye(4)
        for of, least in zip(moves, proved, strict=True):
            T_base_tool = robot.T_base_tool(erring(cell.unit.positions(of.move.path.start)))
            if of.move.held is not None and held is None:
                T_tool_held = np.linalg.inv(T_base_tool) @ at[of.move.held]
            elif of.move.held is None and held is not None:
                at[held] = T_base_tool @ T_tool_held
            held = of.move.held
            bodies = [*of.scene.bodies, *(body.at(at[body.name]) for body in of.resting)]
            body = None if of.held is None else of.held[0]
            world = World(of.robot, bodies, body, T_tool_held if body else None, touching_pairs(of.move))
            q = cell.unit.positions(of.move.path.sample(0.2))
            gaps.append(min(world.distance(erring(here)).value for here in q) - least)
    assert min(gaps) > -1e-5
    assert min(gaps) < 4e-3


def test_a_part_takes_off_what_it_may_be_off(
    boxes: tuple[ProgramTask, Plan], monkeypatch: pytest.MonkeyPatch
) -> None:
    task, plan = boxes
    found = erring_clearances(task.cell, plan)
    monkeypatch.setattr(clearances, "_handling_errors", lambda *_: {})
    exact = erring_clearances(task.cell, plan)
    lost = [1e3 * (a - b) for a, b in zip(exact, found, strict=True)]
    assert all(one >= 0.0 for one in lost)
    assert max(lost) > 1.0
