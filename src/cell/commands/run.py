"""``a465 run`` and ``a465 execute``: run a whole task or program, or execute an existing plan file."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

from arm.errors import A465Error, ExecutionStopped, ImpossibleError, InputError
from arm.plan_file import Plan, read_plan
from cell.accuracy.clearances import erring_clearances
from cell.console import Console, OutputLost
from cell.cubes.confirm_placed import nominal_width
from cell.cubes.recovery import Recovery
from cell.doctor.checklist import note_of_open
from cell.files.cube_widths import read_widths
from cell.files.task import Task, task_or_cell
from cell.preview.of_plan import write_page
from cell.program.program_file import PROGRAM, ProgramTask, task_of_file
from cell.report.run_folder import LOG, REPORT, is_run, run_folder
from cell.session.connection import WhichCell, open_cell, require_openable
from cell.session.homed import may_be_real
from cell.session.keyboard import HELP, aborting_keys, hint, keyboard
from cell.session.observer import RunObserver
from cell.session.speed import override_of, planning_speed, tool_words
from cell.task.open_run import TO_START
from cell.task.plan_matches import replayed, require_match, require_scene, require_start_at
from cell.task.programs.resume import resume_program, stopped_in
from cell.task.programs.run import ProgramRun
from cell.task.resume import resume
from cell.task.run import TaskRun
from driver.execution.control import Control
from driver.line.port import require_there
from driver.line.protocol import AXIS_ERROR
from driver.line.signals import caught, interruptible
from driver.mars.mars import Mars
from driver.mars.refusals import refuse_unhomed
from plan.budget import SearchBudget
from plan.trajectory.virtual_unit import NO_UNIT

SIMULATED = WhichCell()
IN_ERROR = (
    "AN AXIS IS IN ERROR: something stopped it. Find out what, and make sure that nothing touches the arm: if you go "
    "on, the error is cleared"
)
Confirm = Callable[[TaskRun], None]
ConfirmPlan = Callable[[TaskRun, Plan], None]
_STATED = ("failure", "advice", "plan_sha256", "index")  # data of an error that the report states


def run_task(
    task_file: Path,
    console: Console,
    where: WhichCell = SIMULATED,
    folder: Path | None = None,
    advice: bool = False,
    confirm: Confirm | None = None,
    watcher: RunObserver | None = None,
    budget: SearchBudget | None = None,
) -> dict[str, Any]:
    """Run a whole task or program and return its report as JSON types.

    Args:
        task_file: task or program to run.
        console: output.
        where: cell to run it in.
        folder: run folder; None: a new one.
        advice: if planning is refused, search for a change that would help.
        confirm: see `opened`; required for a real arm (`cell.task.approval`).
        watcher: observer of the run.
        budget: budget of each planning search.

    Raises:
        InputError: a file, value or port is wrong.
        ImpossibleError: a board was not found, a hole is out of reach, or there is no plan; nothing moved, or the arm
            is at q_start.
        ExecutionStopped: motion stopped; the state is in the error's data.
    """
    task_or_cell(task_file).require_kind("task", "program")
    task = task_of_file(task_file)
    _note_open_items(task, where, console)
    speed = planning_speed(task.cell, where.speed)
    with opened(task, console, where, speed, folder, Control(), confirm, watcher) as run:
        if run.connection.simulated is not None:
            from cell.sim.made import require_boards_of

            require_boards_of(task, run.connection.simulated.world)
        run.advice, run.budget = advice, budget
        run.recovery = Recovery(task, task.cell.recovery_attempts)
        before = run.try_look("before anything moves")
        if before is not None and not run.foresee(before):
            return run.report()
        run.initialise_arm()
        run.go_to_start(before)
        run.after_homing()
        seen = run.look("from q_start")
        run.carry_out(seen)
        return run.require_confirmed()


def execute_plan(
    plan_file: Path,
    task_file: Path,
    console: Console,
    where: WhichCell = SIMULATED,
    folder: Path | None = None,
    confirm: ConfirmPlan | None = None,
    watcher: RunObserver | None = None,
) -> dict[str, Any]:
    """Execute a plan file if it is valid and matches the present cell; return the report as JSON types.

    The arguments are those of `run_task`, and:

    Args:
        plan_file: plan to execute; the speed of `where` lowers all its velocities (`cell.session.speed`).
        task_file: task with the cell of the plan.
        confirm: called with the plan, too.

    Raises:
        InputError: a file, value or port is wrong.
        ImpossibleError: the plan is invalid or for another cell, a board or cube is not where the plan expects it, or a
            cube is too likely to miss its pocket; nothing moved, or the arm is at q_start.
        ExecutionStopped: motion stopped, or the cell changed during the run; the state is in the error's data.
    """
    plan, task = _plan_to_send(plan_file), task_of_file(task_file)
    cell, control = task.cell, Control(ceiling=override_of(plan, where.speed))
    require_openable(task, where)
    _note_open_items(task, where, console)
    with console.doing("checking the plan"):
        moves = replayed(task, plan)
        erring_clearances(cell, plan)
    require_start_at(task, plan)
    speed = f"speed {plan.speed * control.ceiling:g}"
    speed += f", lowered from the plan's {plan.speed:g}" if control.ceiling < 1.0 else ""
    tool = f"; {tool_words(plan, cell.robot_holding(), cell.unit, control.ceiling)}" if moves else ""
    console.step(f"plan {plan.sha256[:12]}: {len(moves)} moves verified for this cell; {speed}{tool}")
    with opened(task, console, where, plan.speed, folder, control, _of_plan(confirm, plan), watcher) as run:
        run.followed = plan_file if plan.task["cubes"] else None
        before = run.try_look("before anything moves")
        if before is not None:
            require_scene(task, plan, before)
            run.require_accuracy(before, plan, given=True)
        run.initialise_arm()
        run.go_to_start(before)
        run.after_homing()
        seen = run.look("from q_start")
        require_scene(task, plan, seen)
        run.require_accuracy(seen, plan, given=True)
        run.keep(plan, "plan")
        again = False
        if plan.task["cubes"]:
            _, again = run.follow(plan, seen)
        else:
            run.follow_through(plan)
        report = run.require_confirmed()
    if again:
        raise ExecutionStopped(f"{run.remarks[-1]}; plan again", **report)
    return report


def resume_plan(
    plan_file: Path,
    task_file: Path,
    console: Console,
    where: WhichCell,
    folder: Path | None = None,
    confirm: ConfirmPlan | None = None,
    watcher: RunObserver | None = None,
    budget: SearchBudget | None = None,
) -> dict[str, Any]:
    """Continue after a stop: replan the rest of a plan from the arm's present position; arguments as in `execute_plan`.

    Raises:
        InputError: a file, value or port is wrong.
        ImpossibleError: the plan is for another cell, the unit lost its positions, or no certified motion was found.
        ExecutionStopped: motion stopped; the state is in the error's data.
    """
    if where.port is None:
        raise InputError("--resume needs --port: every command starts a new simulated cell", port=None)
    plan, task = _plan_to_send(plan_file), task_of_file(task_file)
    control = Control(ceiling=override_of(plan, where.speed))
    _note_open_items(task, where, console)
    if not plan.task.get("cubes") and (followed := _followed_beside(plan_file, task)) is not None:
        why = f"{plan_file}: is not the plan that the run followed; resume with {followed}"
        raise InputError(why, file=str(plan_file), followed=str(followed))
    require_match(task, plan)
    # the arm may begin anew on all of a program; of a task with cubes the rest is planned anew
    if isinstance(task, ProgramTask):
        with console.doing("checking the plan"):
            replayed(task, plan)
            erring_clearances(task.cell, plan)
    if not (plan.task.get("cubes") or isinstance(task, ProgramTask)):
        why = f"{plan_file}: the plan moves no cubes, so its remaining part is unknown; execute it again as a whole"
        raise ImpossibleError(why, file=str(plan_file))
    with opened(task, console, where, plan.speed, folder, control, _of_plan(confirm, plan), watcher) as run:
        run.followed, run.budget = plan_file, budget
        if isinstance(run, ProgramRun):
            resume_program(run, plan, stopped_in(plan_file.with_name(REPORT), plan))
        else:
            run.widths = read_widths(plan_file.parent, nominal_width(task.cell))
            resume(run, plan)
        return run.require_confirmed()


def _followed_beside(plan_file: Path, task: Task) -> Path | None:
    """Return the newest plan in a run's folder that `--resume` can continue, if this file, such as the way to the
    start, is none."""
    whole = isinstance(task, ProgramTask) and plan_file.stem != TO_START
    if whole or not is_run(plan_file.parent):
        return None
    others = {p: p.stat().st_mtime for p in plan_file.parent.glob("*.json") if p.name != REPORT}
    for file in sorted(others, key=others.__getitem__, reverse=True):
        with suppress(A465Error):
            moves = read_plan(file).task
            if moves.get("cubes") or (moves.get("kind") == PROGRAM and file.stem != TO_START):
                return file
    return None


def _note_open_items(task: Task, where: WhichCell, console: Console) -> None:
    """Tell of doubtful joint angles, and a person who lets a real arm move which items of the checklist are open."""
    for doubt in task.doubts():
        console.say(f"NOTE: {doubt}")
    if where.port is not None and may_be_real(where.port) and (note := note_of_open(task.cell)):
        console.say(note)


def require_sendable(plan_file: Path, task_file: Path, where: WhichCell) -> None:
    """Require what can be known without the unit, before a person is asked to confirm anything.

    Raises:
        InputError: a file, value or port is wrong.
        ImpossibleError: the plan is for another cell, or an arm without a controller.
    """
    plan, task = _plan_to_send(plan_file), task_of_file(task_file)
    override_of(plan, where.speed)
    require_openable(task, where)
    if where.port is not None:
        require_there(where.port)
    require_match(task, plan)


def _plan_to_send(plan_file: Path) -> Plan:
    """Read a plan.

    Raises:
        ImpossibleError: it is for an arm without a controller.
    """
    plan = read_plan(plan_file)
    if plan.unit == NO_UNIT:
        why = (
            f"{plan_file}: unit = {NO_UNIT!r}: the plan is for an arm without a controller, and is never sent; "
            "a465 export gives its motion to other programs"
        )
        raise ImpossibleError(why, file=str(plan_file), unit=NO_UNIT)
    return plan


def _of_plan(confirm: ConfirmPlan | None, plan: Plan) -> Confirm | None:
    """Bind the confirmation to the plan as read: the file may have changed since."""
    return None if confirm is None else lambda run: confirm(run, plan)


@contextmanager
def opened(
    task: Task,
    console: Console,
    where: WhichCell,
    speed: float,
    chosen: Path | None,
    control: Control,
    confirm: Confirm | None = None,
    watcher: RunObserver | None = None,
    name: str | None = None,
    keys: str | None = HELP,
) -> Iterator[TaskRun]:
    """Open a cell and yield a run in it. A report is written to the run folder however the run ends.

    Args:
        task, console, where, watcher: see `run_task`.
        speed: fraction of the speed registers that plans use.
        chosen: run folder; None: a new one.
        control: control of the execution.
        confirm: called before anything moves, to ask the operator; raises on refusal.
        name: of a new run folder; None: that of the task.
        keys: which keys act: those of `keyboard` on the control, or those of `aborting_keys`; None: none.
    """
    with (
        console.heard(),
        interruptible(ends=True),
        run_folder(chosen, name or task.name) as folder,
        open_cell(task, where, folder / LOG) as connection,
    ):
        control.tell = console.step
        kind = ProgramRun if isinstance(task, ProgramTask) else TaskRun
        run = kind(task, connection, console, speed, folder, control, watcher=watcher or RunObserver())
        run.homed_before, run.preload, run.write_page = where.homed, where.preload, write_page
        permitted = confirm is None
        try:
            run.introduce()
            if confirm is not None:  # nobody is asked about another arm
                connection.mars.require_unit()
            if run.homed_before:  # queried again before anything moves
                refuse_unhomed(task.cell.unit, run.connection.mars.counters())
            if confirm is not None:
                if connection.mars.status().word & AXIS_ERROR:
                    console.say(IN_ERROR)
                confirm(run)
                permitted = True
            with _keys(keys, control) as heard:
                if heard and keys is not None:
                    console.say(keys)
                if heard and keys == HELP:
                    run.hint = lambda running: hint(control, running)
                yield run
        except KeyboardInterrupt:
            caught()
            raise _ended(run, _interrupted(connection.mars, permitted), where) from None
        except A465Error as error:
            end = _ended(run, _with_state(run, error), where)
            if end is error:
                raise
            raise end from error


def _keys(keys: str | None, control: Control) -> AbstractContextManager[bool]:
    if keys is None:
        return nullcontext(False)
    return keyboard(control) if keys == HELP else aborting_keys()


def _interrupted(mars: Mars, permitted: bool) -> ExecutionStopped:
    """Return the error of an interrupt between motions, with the arm's state if the arm was allowed to move."""
    if not permitted:
        return ExecutionStopped(
            "interrupted before the arm was allowed to move; nothing moved", reason="interrupted"
        )
    if not mars.link.identified:
        return ExecutionStopped("interrupted before anything was sent; nothing moved", reason="interrupted")
    return mars.stop().error("interrupted between motions", mars.unit, reason="interrupted")


def _with_state(run: TaskRun, error: A465Error) -> A465Error:
    """Add the arm's state to an error that ends a run in which the arm may have moved."""
    mars = run.connection.mars
    stopped = isinstance(error, ExecutionStopped)
    if (
        not mars.link.identified
        or "state" in error.data
        or not (stopped or (run.homed and isinstance(error, InputError)))
    ):
        return error
    return mars.stop().error(str(error), mars.unit, **error.data)


def _ended(run: TaskRun, error: A465Error, where: WhichCell) -> A465Error:
    """Write the report of a run that an error ended, and print how to resume it."""
    error.data["folder"] = str(run.folder)
    words: list[str] = []
    port, images, camera = where.port, where.images, where.camera
    if isinstance(error, ExecutionStopped) and run.followed is not None and run.homed and port is not None:
        error.data["resume_with"] = str(run.followed)
        words = ["a465", "execute", str(run.followed), str(run.task.file), "--port", port]
        words += [] if images is None else ["--images", str(images)]
        words += [] if camera is None else ["--camera", camera]
        words += ["--preload"] if where.preload else []
        words += ["--speed", f"{run.speed * run.control.override:.4g}"] if run.control.override < 1.0 else []
    with suppress(OutputLost):  # must not replace the error, which is printed on standard error
        failed = {"kind": type(error).__name__, "word": error.word, "message": str(error)}
        known = {key: error.data[key] for key in _STATED if key in error.data}
        run.write_report({"error": {**failed, "exit_code": error.exit_code, **known}})
        if isinstance(error, ExecutionStopped):
            if "cubes" not in error.data:  # else the table was printed
                run.tell_rows()
            run.console.say(f"images, plans and the log are in {run.folder}")
            if words:
                run.console.say(f"to go on: {shlex.join([*words, '--resume'])}")
    return error
