"""A run on an open cell: look, execute steps, collect the data for the report, and write it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.io.storage import write_atomic
from arm.plan_file import GripperStep, Plan, Step, write_plan
from arm.se3 import Array, frozen
from cell.accuracy.budget_report import budget_to_json
from cell.accuracy.placement import PlacementBudget
from cell.console import Console
from cell.cubes.confirm_placed import Release
from cell.cubes.recovery import Recovery
from cell.files.observation import require_boards
from cell.files.task import Task
from cell.program.program_file import PROGRAM
from cell.report.cubes import UNDECIDED, CubeRow, print_rows
from cell.report.run_folder import PICTURE, REPORT
from cell.report.run_page import KeptPlan, Picture, run_page
from cell.scene.build import cube_name
from cell.session.camera_watch import shift_words
from cell.session.connection import Connection
from cell.session.grasp_monitor import GraspMonitor
from cell.session.homed import initialise_arm, may_be_real
from cell.session.observer import RunObserver
from cell.task.look import look_and_save
from driver.execution.control import Control
from driver.execution.execute import StepResult, execute
from driver.execution.progress import Progress, StreamOptions
from driver.mars.streaming.preload import refuse_preload
from plan.budget import SearchBudget
from vision.background.camera_shift import UNRECOGNISED
from vision.camera.model import Image
from vision.observation import Observation
from vision.occupancy.seated import CubeWidth

WritePage = Callable[[Task, Plan, Path, Sequence[PlacementBudget], Image | None], None]
TO_START = "to-start"  # name of a plan that only moves to q_start


@dataclass(eq=False)
class OpenRun:
    """A run of a task on an open cell: its state, and the actions that all stages share.

    Attributes:
        task: the task.
        connection: an open cell.
        console: for progress.
        speed: for which plans are made; see `cell.session.speed`.
        folder: for plans, pictures and the report.
        control: pause, abort and speed override during the run.
        hint: returns the end of the status line for the override of the present motion.
        watcher: observer of plans, steps and motion.
    """

    task: Task
    connection: Connection
    console: Console
    speed: float
    folder: Path
    control: Control = field(default_factory=Control)
    hint: Callable[[float], str] = lambda _: ""
    watcher: RunObserver = field(default_factory=RunObserver)

    def __post_init__(self) -> None:
        self.watcher.begins(self.task, self.control)
        self.rows: list[CubeRow] = []
        self.done: dict[str, str] = {}  # cube -> place
        self.on_table: dict[str, Array] = {}
        self.held: GraspMonitor | None = None
        self.given_up: set[int] = set()  # holes of the source board
        self.kept: list[KeptPlan] = []
        self.pictures: list[Picture] = []
        self.began = datetime.now().astimezone()
        self.remarks: list[str] = []
        self.budgets: dict[str, PlacementBudget] = {}  # of each cube, by the last plan that moves it
        self.followed: Path | None = None  # file of the plan under execution, if it moves cubes
        self.homed = False  # homed in this run, so a stop can be resumed
        self.homed_before = False  # homed before this run, so it is not homed again
        self.preload = False  # whether each motion is verified before it begins
        self.after_homing: Callable[[], None] = lambda: None
        self.write_page: WritePage = lambda *_: None  # the preview of a plan
        self.budget: SearchBudget | None = None  # of each search for a plan
        self.widths: dict[str, CubeWidth] = {}  # of cubes that were in the jaws at a stop, as measured before
        self.advice = False  # whether to give advice after a refusal to plan
        self.photographs: int | None = None  # in a look; None: the cell file's number
        self.second_looks = 0  # taken in this run
        self._looks = count(1)
        self._photograph: Image | None = None  # of the last look
        self._released: list[Release] = []  # since the last look
        self.recovery = Recovery(self.task, 0)

    def introduce(self) -> None:
        """Report the task, the cell and the speed, and identify the controller."""
        simulated, url = self.connection.simulated, self.connection.mars.link.url
        where = "the real cell" if may_be_real(url) else f"the unit on {url}"
        if simulated is not None:
            where = f"{simulated.kind}, time scale {self.connection.time_scale:g}"
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

    def look(self, why: str) -> Observation:
        """Look from where the arm is, and require the boards of the task.

        Raises:
            ImpossibleError: one is missing, or not where the task allows it.
        """
        observation = self.see(why)
        require_boards(observation, self.task)
        return observation

    def try_look(self, why: str) -> Observation | None:
        """Look while the arm may be in view; None if it hides a board or the background.

        What follows then relies on no image: the arm moves to q_start past everything that may stand in the zone.
        """
        try:
            observation = self.see(why)
        except ImpossibleError as error:
            if error.data.get("reason") != UNRECOGNISED:
                raise
            self.console.step("the arm may hide the background: boards and camera are checked from q_start")
            return None
        if observation.half_seen or any(observation.board(b.name) is None for b in self.task.boards):
            self.console.step("the arm may be in view: reach is checked from q_start")
            return None
        require_boards(observation, self.task)
        return observation

    def see(self, why: str, arm_in_view: bool = False) -> Observation:
        """Look from where the arm is, without requirements."""
        number = next(self._looks)
        picture = self.folder / PICTURE.format(number)
        self.pictures.append(Picture(why, picture))
        self.connection.mars.note("look", picture=picture.name, why=why)
        with self.console.doing("looking"):
            seen = look_and_save(
                self.task, self.connection.frames, picture, self.console, why, arm_in_view, self.photographs
            )
        self._photograph = seen.images[0]
        if (moved := shift_words(seen.camera_shift)) is not None:
            self.remarks.append(f"look {number}: {moved}")
        return seen

    def initialise_arm(self) -> None:
        """Home the arm, unless it was homed before; open the jaws."""
        initialise_arm(self.connection.mars, self.task.cell, self.console, self.homed_before)
        self.homed = True

    def q_now(self) -> Array:
        """Configuration of the arm at rest, (6,) rad."""
        return frozen(self.task.cell.unit.positions(self.connection.mars.settled_counts()))

    def keep(self, plan: Plan, name: str) -> None:
        """Write a plan to the folder, with its preview unless it only goes to q_start."""
        self.kept.append(KeptPlan(name, plan))
        file = self.folder / f"{name}.json"
        write_plan(file, plan)
        if plan.task["cubes"] or (plan.task.get("kind") == PROGRAM and name != TO_START):
            self.followed = file
        self.connection.mars.note("plan", file=f"{name}.json", sha256=plan.sha256)
        if name.startswith("plan"):
            page = self.folder / name.replace("plan", "preview")
            budgets = [b for cube in plan.task["cubes"] if (b := self.budgets.get(cube["cube"])) is not None]
            self.write_page(self.task, plan, page.with_suffix(".html"), budgets, self._photograph)
        self.watcher.plan(plan, name)

    def follow_through(self, plan: Plan) -> None:
        """Execute all steps of a plan that moves no cubes.

        Raises:
            ExecutionStopped: a motion stopped; data: `plan_sha256`, and the `index` of the step.
        """
        try:
            self.execute(plan.steps)
        except ExecutionStopped as error:
            error.data["plan_sha256"] = plan.sha256
            raise
        lasted = plan.duration_s / self.control.ceiling
        self.console.step(f"done: {len(list(plan.moves))} moves, {lasted:.1f} s of motion")

    def execute(self, steps: Sequence[Step], options: StreamOptions | None = None) -> tuple[StepResult, ...]:
        """Execute steps under `control`."""
        if not steps:
            return ()
        mars, control = self.connection.mars, self.control
        options = replace(options or StreamOptions(), preload=self.preload)
        return execute(mars, steps, self._on_step, self._on_progress, options=options, control=control)

    def _on_step(self, step: Step, index: int, total: int) -> None:
        self._step_name = step.name
        self.watcher.step(step)
        if self.held is not None and isinstance(step, GripperStep):
            self.held.require(self.connection.mars.jaws(), readings=1)  # at rest one reading suffices

    def _on_progress(self, progress: Progress) -> None:
        self.watcher.progress(progress)
        self.console.progress(
            self._step_name, progress.done / max(progress.total, 1), self.hint(progress.override)
        )
        if self.held is not None and progress.jaws is not None:
            self.held.require(progress.jaws)

    def add_row(self, transfer: dict[str, str]) -> CubeRow:
        """The row of a cube in the report: a new one, or that of its last transfer."""
        row = next((row for row in self.rows if cube_name(row.source) == transfer["cube"]), None)
        if row is None:
            row = CubeRow(transfer["cube"].removeprefix(cube_name("")), transfer["to"])
            self.rows.append(row)
        elif transfer["to"] not in (row.source, UNDECIDED):  # else it is put back, or stays
            row.target = transfer["to"]
        return row

    def tell(self, text: str) -> None:
        """Print a remark, and keep it for the report."""
        self.remarks.append(text)
        self.console.step(text)

    def report(self) -> dict[str, Any]:
        """Print the table, write the report, and return it as JSON types."""
        self.tell_rows()
        self.write_report({})
        self.console.say(
            f"\nimages, plans and log are in {self.folder}; open {self.folder / 'report.html'} for the summary"
        )
        return self.to_json()

    def tell_rows(self) -> None:
        """Print a row for each cube that was started, and what touched the wires of a program."""
        if self.rows:
            print_rows(self.console, self.rows)
        if (simulated := self.connection.simulated) is not None:
            for touches in simulated.touches():
                self.console.step(touches.words())

    def write_report(self, more: dict[str, Any]) -> None:
        """Write ``report.json`` with `more`, and ``report.html``.

        A failure to write them is printed, and does not hide how the run ended.
        """
        report = {**self.to_json(), **more}
        try:
            write_atomic(self.folder / REPORT, json.dumps(report, indent=2, allow_nan=False) + "\n")
            now = datetime.now().astimezone()
            budgets = list(self.budgets.values())
            page = run_page(self.task, report, self.pictures, self.kept, self.began, now, budgets)
            write_atomic(self.folder / "report.html", page)
        except InputError as error:
            self.tell(f"no report: {error}")

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON types."""
        whole = [kept.plan for kept in self.kept if kept.name != TO_START]
        simulated = self.connection.simulated
        return {
            "task": self.task.name,
            "began": self.began.isoformat(timespec="seconds"),
            "lasted_s": round((datetime.now().astimezone() - self.began).total_seconds(), 1),
            "kind": self.task.kind,
            "unit": self.task.cell.unit.name,
            "cubes": [row.to_json() for row in self.rows],
            "cubes_planned": len(whole[0].task["cubes"]) if whole else 0,
            "plan_sha256": whole[0].sha256 if whole else None,
            "plans_sha256": [p.sha256 for p in whole],
            "motion_s": round(sum(p.duration_s for p in whole), 3),
            "speed": self.speed,
            "override": self.control.ceiling,
            "time_scale": self.connection.time_scale,
            "arm_shape": self.task.cell.arm_shape(),
            "simulated": simulated is not None,
            "emulated": simulated is None and not may_be_real(self.connection.mars.link.url),
            "wires": [] if simulated is None else [touches.to_json() for touches in simulated.touches()],
            "placements": [budget_to_json(budget) for budget in self.budgets.values()],
            "second_looks": self.second_looks,
            "remarks": self.remarks,
            "folder": str(self.folder),
        }
