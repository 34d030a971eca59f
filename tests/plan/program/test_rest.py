"""The rest of a stopped plan is the same path, certified, from where the arm is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.plan_file import Move, Plan
from cell.program.planning import plan_of_program, program_options, program_scene, require_threads
from cell.program.program_file import ProgramTask, read_program
from cell.task.plan_matches import replayed
from plan.program.rest import NEAR, place_on, rest_of_plan
from plan.program.setting import Setting
from vision.observation import Observation

PROGRAM = data_file("scenes/hoop/b.toml")
SPEED = 1.0


@cache
def _planned() -> tuple[ProgramTask, Plan, Setting]:
    task = read_program(PROGRAM)
    plan = plan_of_program(task, Observation(), SPEED)
    options = program_options(task, plan.speed)
    return (
        task,
        plan,
        Setting(program_scene(task, Observation()), task.cell.unit, task.cell.limits, options),
    )


def _on_wire(share: float, step: int = 1) -> np.ndarray:
    task, plan, _ = _planned()
    path = plan.steps[step].path  # type: ignore[union-attr]
    return np.asarray(task.cell.unit.positions(path.at([share * path.duration_s]))[0])


@pytest.mark.parametrize("share", [0.5, *(pytest.param(s, marks=pytest.mark.slow) for s in (0.1, 0.93))])
@pytest.mark.parametrize("step", [1, 2])
def test_the_rest_is_the_same_path_certified_and_threaded_from_where_the_arm_is(
    step: int, share: float
) -> None:
    task, plan, setting = _planned()
    unit, off = task.cell.unit, np.array([0.002, -0.001, 0.001, 0.002, 0.0, -0.002])
    q = unit.positions(unit.counts(_on_wire(share, step) + off))
    place = place_on(plan, unit, q, step)
    assert (place.step, place.off) == (step, pytest.approx(0.002, abs=2e-3))
    rest = rest_of_plan(plan, setting, place, q)
    assert [m.name for m in rest.moves] == [m.name for m in list(plan.moves)[step:]]
    assert rest.start == tuple(unit.counts(q))
    assert [m.threaded for m in rest.moves if m.threaded] == ["b"] * (3 - step)
    assert len(replayed(task, rest)) == 4 - step  # as it would be sent: limits, joins, clearance, thread
    before = np.concatenate([unit.positions(m.path.sample(0.001)) for m in list(plan.moves)[step:]])
    for move in rest.moves:
        for q_now in unit.positions(move.path.sample(0.05)):
            assert np.abs(before - q_now).max(axis=1).min() < 0.004
    end = [list(p.moves)[-1].path.end for p in (plan, rest)]
    assert np.abs(np.subtract(*end)).max() <= unit.rest_tolerance
    assert min(m.clearance for m in rest.moves) >= task.required
    lasts = sum(m.path.duration_s for m in list(plan.moves)[step:]) - place.time_s
    assert lasts - 0.3 < rest.duration_s < lasts + 1.5


def test_without_a_report_the_first_of_the_places_counts_and_with_one_that_of_the_step() -> None:
    task, plan, _ = _planned()
    unit, q = task.cell.unit, _on_wire(0.5)
    assert place_on(plan, unit, q).step == 1
    assert place_on(plan, unit, q, 2).step == 2
    assert place_on(plan, unit, q, 1).step == 1
    assert place_on(plan, unit, unit.positions(plan.start)).step == 0
    assert place_on(plan, unit, q + 0.1).off > NEAR


def test_a_plan_of_which_a_rest_is_left_is_no_plan_of_the_whole_program() -> None:
    task, plan, setting = _planned()
    q = _on_wire(0.5, 2)
    rest = rest_of_plan(plan, setting, place_on(plan, task.cell.unit, q, 2), q)
    assert rest.task["threaded_before"] == 1
    with pytest.raises(ImpossibleError, match="moves on b; the program asks for b, b"):
        replayed(task, replace(rest, task={**rest.task, "threaded_before": 0}))
    again = rest_of_plan(rest, setting, place_on(rest, task.cell.unit, q, 0), q)
    assert again.task["threaded_before"] == 1


def test_a_plan_from_the_start_has_no_threaded_moves_behind_it() -> None:
    """Else a plan could say so of all of them, and nothing would be proved of the ring."""
    task, plan, _ = _planned()
    bare = tuple(replace(s, threaded=None) if isinstance(s, Move) else s for s in plan.steps)
    for steps, before in ((bare, 2), (plan.steps, 3)):
        stated = replace(plan, steps=steps, task={**plan.task, "threaded_before": before})
        with pytest.raises(ImpossibleError, match=f"states {before} threaded moves before its first one"):
            replayed(task, stated)


def test_a_plan_that_begins_a_count_beside_q_start_is_one_from_the_start() -> None:
    """`execute` takes a plan that begins within the tolerance of rest; what it says was done before has to agree."""
    task, plan, _ = _planned()
    first = next(plan.moves)
    start = (first.path.start[0] + 1, *first.path.start[1:])
    near = replace(first, path=replace(first.path, start=start), threaded=None)
    bare = (near, *(replace(s, threaded=None) if isinstance(s, Move) else s for s in plan.steps[1:]))
    with pytest.raises(ImpossibleError, match="states 2 threaded moves before its first one"):
        require_threads(task, replace(plan, steps=bare, task={**plan.task, "threaded_before": 2}))


def test_a_plan_states_the_board_of_its_programs_work() -> None:
    task, plan, _ = _planned()
    with pytest.raises(
        ImpossibleError, match=r"a workpiece on board 01-02, but that of b.toml is on no board"
    ):
        replayed(task, replace(plan, task={**plan.task, "board": "01-02"}))


@pytest.mark.slow
def test_a_tool_that_has_a_speed_keeps_it_on_the_rest_of_its_path() -> None:
    task, _, setting = _planned()
    slow = replace(task, steps=tuple(replace(step, speed=0.06) for step in task.steps))
    plan, robot, unit = plan_of_program(slow, Observation(), SPEED), setting.robot, task.cell.unit
    path = plan.steps[1].path  # type: ignore[union-attr]
    q = unit.positions(path.at([0.4 * path.duration_s]))[0]
    rest = rest_of_plan(plan, setting, place_on(plan, unit, q, 1), unit.positions(unit.counts(q)))
    tool = [robot.T_base_tool(one)[:3, 3] for one in unit.positions(next(rest.moves).path.sample(0.02))]
    speeds = np.linalg.norm(np.diff(tool, axis=0), axis=1) / 0.02
    assert 0.04 < speeds.max() < 0.062


def test_nothing_is_left_of_a_plan_that_was_finished() -> None:
    task, plan, setting = _planned()
    q = task.cell.unit.positions(list(plan.moves)[-1].path.end)
    with pytest.raises(ImpossibleError, match="nothing of the plan is left to do"):
        rest_of_plan(plan, setting, place_on(plan, task.cell.unit, q, 3), q)
