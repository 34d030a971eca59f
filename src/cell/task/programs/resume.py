"""Continue a program after a stop: along the same path, from where the arm is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import ImpossibleError
from arm.plan_file import Plan
from cell.accuracy.clearances import erring_clearances
from cell.files.board_shift import board_shift
from cell.program.planning import program_options
from cell.task.plan_matches import planned_observation, replayed, scene_of_now
from cell.task.programs.run import ProgramRun
from plan.program.rest import NEAR, handled_before, place_on, rest_of_plan
from plan.program.setting import Setting
from vision.observation import Observation

_BY_HAND = "take the tool clear of the workpiece by hand, and run the program again"


def stopped_in(report_file: Path, plan: Plan) -> int | None:
    """Return the index of the step in which a plan was stopped, by the report beside it; None if that does not say."""
    try:
        report: Any = json.loads(report_file.read_text())
        error = report["error"]
        index = int(error["index"]) if error["plan_sha256"] == plan.sha256 else None
    except (OSError, ValueError, KeyError, TypeError):
        return None  # no report, or one of another run: then the place alone tells
    return index if index is not None and 0 <= index < len(plan.steps) else None


def resume_program(run: ProgramRun, plan: Plan, index: int | None) -> None:
    """Finish a stopped plan of a program.

    An arm that is not on the plan's path (`NEAR`) goes to q_start first, and begins anew.

    Args:
        run: on an open cell.
        plan: the stopped plan.
        index: of the step in which it was stopped, if that is known.

    Raises:
        ImpossibleError: the unit lost its positions, the board moved, or there is no certified motion from where the
            arm is; nothing moved.
        ExecutionStopped: motion stopped again.
    """
    mars, cell = run.connection.mars, run.task.cell
    try:
        mars.initialise(home=False)
    except ImpossibleError as error:
        raise ImpossibleError(f"{error}; before it is homed, {_BY_HAND}", **error.data) from error
    run.homed = True
    mars.set_registers(cell.speed_registers, cell.acceleration_registers)
    parts = run.task.part is not None
    if parts and index is None:
        why = "the report beside the plan does not say in which step it was stopped, so what was put down is unknown"
        raise ImpossibleError(f"{why}; take the parts out by hand, and run the program again")
    q = run.q_now()
    shown = ", ".join(f"{d:.1f}" for d in np.degrees(q))
    run.console.step(f"the arm stands at [{shown}] deg")
    observation = _require_boards(run, plan)
    place = place_on(plan, cell.unit, q, index)
    if place.off > NEAR:
        if handled := handled_before(plan, place.step) if parts else 0:
            why = f"the arm is {np.degrees(place.off):.1f} deg from the path of the plan, which began with the parts: "
            why += f"{handled // 2} were put down{', one is in the jaws' if handled % 2 else ''}"
            raise ImpossibleError(f"{why}; take them out by hand, and run the program again", handled=handled)
        _begin_anew(run, plan, observation, np.degrees(place.off))
        return
    setting = Setting(
        scene_of_now(run.task, plan), cell.unit, cell.limits, program_options(run.task, plan.speed)
    )
    try:
        rest = rest_of_plan(plan, setting, place, q)
        replayed(run.task, rest)
        erring_clearances(cell, rest)
    except ImpossibleError as error:
        raise ImpossibleError(
            f"no certified motion from where the arm stands: {error}; {_BY_HAND}"
        ) from error
    name = plan.steps[place.step].name
    run.console.step(
        f"it goes on in {name!r}, after {place.time_s:.1f} s of it: {rest.duration_s:.1f} s of motion"
    )
    run.keep(rest, "plan")
    run.follow_through(rest)


def _require_boards(run: ProgramRun, plan: Plan) -> Observation:
    """Return the boards of the plan; require those that the arm does not hide to be where the plan has them.

    Raises:
        ImpossibleError: a board is elsewhere.
    """
    cell = run.task.cell
    planned = planned_observation(cell, scene_of_now(run.task, plan))
    if not planned.boards:
        return planned
    seen = run.see("from where the arm stands", arm_in_view=True)
    for board in planned.boards:
        now = seen.board(board.name)
        if now is None:
            run.tell(f"board {board.name} is hidden; it is taken to be where the plan has it")
            continue
        T_then, T_now = board.pose.T_base_board, now.pose.T_base_board
        shift = board_shift(board.pose.board, cell.cube_size, T_then, T_now, run.task.on_board)
        if shift.beyond(cell):
            why = f"board {board.name} is {shift} from its planned pose; {_BY_HAND}"
            raise ImpossibleError(why, board=board.name)
    return planned


def _begin_anew(run: ProgramRun, plan: Plan, observation: Observation, off_deg: float) -> None:
    """Go to q_start from beside the plan's path, and execute all of it."""
    beside = f"the arm is {off_deg:.1f} deg from the path of the plan"
    try:
        run.go_to_start(observation)
    except ImpossibleError as blocked:
        why = f"{beside}, and no certified motion leads from there to q_start: {blocked}; {_BY_HAND}"
        raise ImpossibleError(why, blocked=str(blocked)) from blocked
    run.console.step(f"{beside}: it begins anew from q_start")
    run.keep(plan, "plan")
    run.follow_through(plan)
