"""One run of a task on an open cell: its stages, and what became of every cube."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import ExecutionStopped, InputError
from arm.planfile import GripperStep, Plan, Step, write_plan
from arm.se3 import Array, frozen
from cell.budgeted import spending
from cell.confirming import LetGo, require_confirmed, unseen_places, width_at
from cell.connection import Connection
from cell.console import Console
from cell.cubewidths import width_kept
from cell.explaining import explained
from cell.holding import Held, grip_of
from cell.homed import take_into_use
from cell.lookfile import Seen
from cell.looking import look_and_save
from cell.pages import write_page
from cell.planning import back_out, plan_rest, plan_to_start, reach_of
from cell.report import CubeRow, judge_release, print_rows
from cell.runpage import KeptPlan, Picture
from cell.runreport import TO_START, run_report, write_run_report
from cell.scenery import T_base_cube_on_table, cube_name
from cell.speed import tool_words
from cell.taskfile import Task
from cell.visits import Visit, visits
from cell.watcher import Watcher
from driver.control import Control
from driver.execute import StepResult, execute
from driver.preload import refuse_preload
from driver.progress import Progress, StreamOptions
from plan.budget import SearchBudget
from vision.seated import CubeWidth


class TaskRun:
    """State of one run; every public method is one stage.

    Args:
        task: what is to be done.
        connection: an open cell.
        console: where progress is told.
        speed: that plans are made for, see `cell.speed`.
        folder: where plans, pictures and the report go.
        control: what may be asked for while it runs.
        hint: the end of the status line, for the override of the motion that runs.
        watcher: is told of plans, steps and motion.
    """

    def __init__(
        self,
        task: Task,
        connection: Connection,
        console: Console,
        speed: float,
        folder: Path,
        control: Control | None = None,
        hint: Callable[[float], str] = lambda _: "",
        watcher: Watcher | None = None,
    ) -> None:
        self.task = task
        self.connection = connection
        self.console = console
        self.speed = speed
        self.folder = folder
        self.control = control or Control()
        self.hint = hint
        self.watcher = watcher or Watcher()
        self.watcher.begins(task, self.control)
        self.rows: list[CubeRow] = []
        self.done: dict[str, str] = {}  # cube -> place
        self.on_table: dict[str, Array] = {}
        self.held: Held | None = None
        self.given_up: set[int] = set()  # holes of the source board
        self.plans: list[Plan] = []
        self.kept: list[KeptPlan] = []
        self.pictures: list[Picture] = []
        self.began = datetime.now().astimezone()
        self.remarks: list[str] = []
        self.followed: Path | None = None  # the plan file that is executed, once cubes are moved
        self.homed = False  # in this run: a stop can be gone on from
        self.homed_before = False  # and stays so: nothing is homed
        self.preload = False  # motions are verified before they begin
        self.after_homing: Callable[[], None] = lambda: None
        self.budget: SearchBudget | None = None  # of each search for a plan
        self.widths: dict[str, CubeWidth] = {}  # of cubes that were in the jaws at a stop, as measured before
        self.advice = False  # whether a refusal to plan is followed by advice
        self._looks = count(1)
        self._let_go = LetGo(task)

    def introduce(self) -> None:
        """Say what is about to happen and where, and make sure that a controller of the right kind listens."""
        of = f"the simulated cell, time scale {self.connection.time_scale:g}"
        where = "the real cell" if self.connection.simulated is None else of
        speed = f"speed {self.speed * self.control.ceiling:g}"
        self.console.step(f"task {self.task.name}: {self.task.kind} on {where}, {speed}")
        task_file = os.path.relpath(self.task.file, self.folder)
        self.connection.mars.note("run", task=task_file, digest=self.task.digest, **self.task.cell.noted())
        mars = self.connection.mars
        self.console.step(f"controller: {mars.identify()}")
        if not mars.manners.echoes:
            self.console.step(mars.manners.describe())
        if self.preload:
            refuse_preload(mars)

    def look(self, why: str) -> Seen:
        """Look from where the arm is; the boards of the task must be there.

        Raises:
            ImpossibleError: one is not, or not where the task allows it.
        """
        seen = self.see(why)
        seen.require(self.task)
        return seen

    def try_look(self, why: str) -> Seen | None:
        """Look while the arm may stand in view; None if that hides a board."""
        seen = self.see(why)
        if seen.missing_of(self.task) or seen.half_seen:
            self.console.step("the arm may stand in view: reach is checked from q_start")
            return None
        seen.require(self.task)
        return seen

    def see(self, why: str, arm_in_view: bool = False) -> Seen:
        """Look from where the arm is, whatever is found."""
        picture = self.folder / f"look-{next(self._looks)}.png"
        self.pictures.append(Picture(why, picture))
        with self.console.doing("looking"):
            return look_and_save(self.task, self.connection.frames, picture, self.console, why, arm_in_view)

    def check_reach(self, seen: Seen) -> None:
        """Every hole of the task's boards must be in reach.

        Raises:
            ImpossibleError: naming each that is not, and by how much.
        """
        table = reach_of(self.task, seen, self.speed)
        q_start, rest = self.task.cell.q_start, (self.done, self.on_table, self.given_up)
        with explained(self.task, seen, q_start, self.speed, self.advice, *rest, every_hole=True):
            table.require()
        least = min(float(np.degrees(h.best.margin)) for h in table.holes)
        self.console.step(f"reach: all {len(table.holes)} holes, at least {least:.1f} deg from every limit")

    def foresee(self, seen: Seen) -> bool:
        """Plan the whole task from q_start before anything moves, so that what cannot be done is refused here.

        Returns:
            Whether there is anything to do.

        Raises:
            ImpossibleError: with step, hole, joint or pair of bodies and how much.
        """
        self.check_reach(seen)
        q_start = self.task.cell.q_start
        explaining = explained(self.task, seen, q_start, self.speed, self.advice, every_hole=True)
        with self.console.doing("planning"), explaining, spending(self.budget):
            plan = plan_rest(self.task, seen, q_start, self.speed, {}, {})
        if plan is None:
            self.console.step(f"board {self.task.from_board.name} holds no cube: nothing to do")
            return False
        told = tool_words(plan, self.task.cell, self.control.ceiling)
        self.console.step(
            f"foreseen: {len(plan.task['cubes'])} cubes in {plan.duration_s:.1f} s of motion, {told}"
        )
        hidden = unseen_places(self.task, seen, [c["to"] for c in plan.task["cubes"]])
        if hidden:
            self.tell(hidden)
        return True

    def take_into_use(self) -> None:
        """Home the arm, unless it was and is; open the jaws."""
        take_into_use(self)
        self.homed = True

    def go_to_start(self, seen: Seen | None) -> None:
        """Go to q_start, around what was seen, or around all that may stand there."""
        plan = plan_to_start(self.task, seen, self.q_now(), self.speed, self.on_table)
        if plan is not None:
            self.keep(plan, TO_START)
            self.execute(plan.steps)

    def q_now(self) -> Array:
        """Where the arm stands, (6,) rad."""
        return frozen(self.task.cell.unit.positions(self.connection.mars.settled_counts()))

    def move_cubes(self, seen: Seen) -> None:
        """Plan what is left and follow the plan, until nothing is left."""
        plan = self._plan_rest(seen)
        while plan is not None:
            seen, again = self.follow(plan, seen)
            plan = self._plan_rest(seen) if again else None

    def _plan_rest(self, seen: Seen) -> Plan | None:
        q_now, rest = self.q_now(), (self.done, self.on_table, self.given_up)
        explaining = explained(self.task, seen, q_now, self.speed, self.advice, *rest)
        with self.console.doing("planning"), explaining, spending(self.budget):
            plan = plan_rest(self.task, seen, q_now, self.speed, *rest)
        if plan is None:
            return None
        cubes = plan.task["cubes"]
        self.console.step(
            f"planned {len(cubes)} cube{'' if len(cubes) == 1 else 's'}: {plan.duration_s:.1f} s of motion, "
            f"clearance {1e3 * min(m.clearance for m in plan.moves):.1f} mm, {plan.sha256[:12]}"
        )
        self.keep(plan, "plan" if not any(p.task["cubes"] for p in self.plans) else f"plan-{len(self.plans)}")
        return plan

    def keep(self, plan: Plan, name: str) -> None:
        """Write a plan into the folder, with its preview if it moves cubes."""
        self.plans.append(plan)
        self.kept.append(KeptPlan(name, plan))
        file = self.folder / f"{name}.json"
        write_plan(file, plan)
        if plan.task["cubes"]:
            self.followed = file
        self.connection.mars.note("plan", file=f"{name}.json", sha256=plan.sha256)
        if name.startswith("plan"):
            page = self.folder / name.replace("plan", "preview")
            write_page(self.task, plan, page.with_suffix(".html"))
        self.watcher.plan(plan, name)

    def follow(self, plan: Plan, seen: Seen) -> tuple[Seen, bool]:
        """Execute a plan cube by cube; ends early, with True, where the rest must be planned anew.

        Raises:
            ExecutionStopped: a cube is no longer where it should be and not where it came from, so it stands where
                nothing sees it; the arm is at q_start.
        """
        planned = seen
        behind: tuple[Step, ...] = ()  # away from the last place: one motion with those to the next cube
        visited = visits(plan)
        for transfer, visit in zip(plan.task["cubes"], visited, strict=True):
            row = CubeRow(transfer["from"], transfer["to"])
            self.rows.append(row)
            held = self.execute((*behind, *visit.fetch))[-1].gripper
            row.add_motion(visit.fetch)
            if held is None or not held.stalled:
                return self._missed(visit, row, seen, "the jaws closed on nothing"), True
            why_not = grip_of(self.task.cell).why_not(self.task.cell.gripper.width(held.fraction_closed))
            if why_not:
                return self._missed(visit, row, seen, why_not), True
            with width_kept(self.folder, transfer["cube"], partial(self._width, transfer, seen)):
                self._carry(visit.carry, transfer["cube"], held.fraction_closed)
            row.add_motion((*visit.carry, *visit.leave))
            self._put_down(transfer, row, seen)
            seen, behind = seen.with_moves({transfer["cube"]: transfer["to"]}), visit.leave
            last = visit is visited[-1]
            if last or visit.looks:
                self.execute(behind)
                behind = ()
            if not last and not visit.looks:
                continue
            expected, seen = seen, self.look(f"after cube {len(self.rows)}")
            self.confirm_placed(seen)
            changes = seen.moved(planned, self.task.cell) + seen.changed(expected)
            for line in changes:
                self.tell(line + "; the rest is planned anew")
            if changes and not last:
                return seen, True
        return seen, False

    def _carry(self, steps: Sequence[Step], cube: str, grip: float) -> None:
        """Execute the steps of a cube in the jaws; it must be there all the way, and gone after it was let go.

        Raises:
            ExecutionStopped: it was lost on the way, or stays in the jaws, or a motion stopped.
        """
        self.held = Held(cube, grip)
        try:
            opened = self.execute(steps, StreamOptions(watch_jaws=True))[-1].gripper
            if opened is None or opened.stalled:
                raise ExecutionStopped(
                    f"the jaws do not open to let go of {cube}; the arm stands at its place", index=0
                )
        except ExecutionStopped as error:
            if error.data.get("reason") != "lost":
                raise ExecutionStopped(
                    f"{error}; {cube} is in the jaws", **error.data, holding=cube
                ) from error
            raise
        finally:
            self.held = None

    def _width(self, transfer: dict[str, Any], seen: Seen) -> CubeWidth | None:
        """Of a cube, by the last look at its source; None where that does not tell it."""
        known = self.widths.get(transfer["cube"])
        if known is None and transfer["from"] not in seen.moved_since:
            known = width_at(self.task, seen, transfer["from"])
        return known

    def _missed(self, visit: Visit, row: CubeRow, seen: Seen, why: str) -> Seen:
        """The jaws hold no cube: open them where they are, back out the way they came, go to q_start, look."""
        self.tell(f"cube of {row.source} is not gripped: {why}")
        row.remarks.append(why)
        self.given_up.add(int(row.source.rsplit("/", 1)[1]) - 1)
        self.connection.mars.gripper(0.0)
        self.execute(back_out(self.task, seen, visit.approach, self.speed, self.on_table))
        self.go_to_start(seen)
        before, after = seen.state(row.source), self.look("after a missed cube")
        if before == "cube" and after.state(row.source) == "empty":
            self._stop(
                f"the cube of {row.source} is gone from its hole and was not gripped; it stands where it is not seen: "
                "take it away"
            )
        return after

    def confirm_placed(self, seen: Seen) -> None:
        """Judge the cubes that were let go since the last look by this one.

        Raises:
            ExecutionStopped: one may stand where nobody knows.
        """
        for row, found in self._let_go.judge(seen, self.pictures[-1].file):
            self.tell(f"{row.source} to {row.target} {row.remarks[-1]}")
            if found.lost:
                self._stop(
                    f"{row.source} to {row.target} {row.remarks[-1]}; put that cube right or take it away"
                )

    def require_confirmed(self) -> dict[str, Any]:
        """The report of a run all of whose cubes were confirmed.

        Raises:
            ExecutionStopped: one was not; with the report.
        """
        report = self.report()
        require_confirmed(self.rows, report)
        return report

    def _stop(self, why: str) -> None:
        """End the task where a cube is not known to stand where it should; `why` ends in what to do about it."""
        raise ExecutionStopped(
            f"{why}, and run again; the arm is at q_start",
            **self.report(),
        )

    def _put_down(self, transfer: dict[str, Any], row: CubeRow, seen: Seen) -> None:
        """A cube was let go; `seen` is the last look before. Whether it is where it should be, the next one tells."""
        self._let_go.add(row, seen, self.widths.get(transfer["cube"]))
        self.done[transfer["cube"]] = transfer["to"]
        if self.task.places is not None:
            self.on_table[cube_name(transfer["to"])] = T_base_cube_on_table(self.task, transfer["to"])
        if self.connection.simulated is not None:
            judge_release(self.task, self.connection.simulated, row)
        remarks = "".join(f"; {remark}" for remark in row.remarks)
        self.console.step(f"{transfer['cube']} let go at {transfer['to']}{remarks}")

    def finish_carry(
        self,
        carry: Sequence[Step],
        leave: Sequence[Step],
        transfer: dict[str, Any],
        grip: float,
        row: CubeRow,
        seen: Seen,
    ) -> None:
        """Execute steps that begin with a cube in the jaws, closed by `grip`, and those away from where it was put."""
        with width_kept(self.folder, transfer["cube"], partial(self._width, transfer, seen)):
            self._carry(carry, transfer["cube"], grip)
        row.add_motion((*carry, *leave))
        self._put_down(transfer, row, seen)
        self.execute(leave)

    def execute(self, steps: Sequence[Step], options: StreamOptions | None = None) -> tuple[StepResult, ...]:
        """Execute steps, with what may be asked for meanwhile."""
        if not steps:
            return ()
        mars, control = self.connection.mars, self.control
        options = replace(options or StreamOptions(), preload=self.preload)
        return execute(mars, steps, self._on_step, self._on_progress, options=options, control=control)

    def _on_step(self, step: Step, index: int, total: int) -> None:
        self._step_name = step.name
        self.watcher.step(step)
        if self.held is not None and isinstance(step, GripperStep):
            self.held.require(self.connection.mars.jaws(), looks=1)  # at rest a reading is sure

    def _on_progress(self, progress: Progress) -> None:
        self.watcher.progress(progress)
        self.console.progress(
            self._step_name, progress.done / max(progress.total, 1), self.hint(progress.override)
        )
        if self.held is not None and progress.jaws is not None:
            self.held.require(progress.jaws)

    def tell(self, text: str) -> None:
        """Say it, and keep it for the report."""
        self.remarks.append(text)
        self.console.step(text)

    def report(self) -> dict[str, Any]:
        """Print the table and write the report."""
        self.tell_rows()
        self.write_report({})
        self.console.say(
            f"\nwhat was seen, planned and sent is in {self.folder}; {self.folder / 'report.html'} tells it"
        )
        return run_report(self)

    def tell_rows(self) -> None:
        """Print a row for each cube that was begun."""
        if self.rows:
            print_rows(self.console, self.rows)

    def write_report(self, more: dict[str, Any]) -> None:
        """Write the report; that it could not be written is told, and does not hide how the run ended."""
        try:
            write_run_report(self, more)
        except InputError as error:
            self.tell(f"no report: {error}")
