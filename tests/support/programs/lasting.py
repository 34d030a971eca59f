"""A cell that outlives the sessions with its controller, so that a stopped run can be resumed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import cell.commands.run
from arm.errors import ExecutionStopped
from arm.plan_file import Plan, write_plan
from cell.commands.run import execute_plan, resume_plan
from cell.console import Console
from cell.program.program_file import ProgramTask
from cell.session.connection import Connection, WhichCell, join, simulated_cell
from cell.task.run import TaskRun
from driver.emulator import Emulator
from driver.execution.progress import Progress
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars


class Lasting:
    """A simulated cell of a program that outlives the sessions with its controller."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, task: ProgramTask, plan: Plan) -> None:
        self.folder, self.stop_at, self.task = folder, ("", 2.0), task
        self.plan = folder / "plan.json"
        write_plan(self.plan, plan)
        self.simulated, self.clock = simulated_cell(self.task, None), SteppedClock()
        self.emulator = Emulator(self.task.cell.unit, self.clock, plant=self.simulated)
        self.camera, self.line = join(self.simulated, self.emulator), self.emulator.open_line(0.0)
        monkeypatch.setattr(cell.commands.run, "open_cell", self.opened)
        monkeypatch.setattr(cell.commands.run, "require_openable", lambda *_: None)
        plain = TaskRun._on_progress

        def on_progress(run: TaskRun, progress: Progress) -> None:
            plain(run, progress)
            if run._step_name == self.stop_at[0] and progress.done >= self.stop_at[1] * progress.total:
                run.control.abort()

        monkeypatch.setattr(TaskRun, "_on_progress", on_progress)

    @contextmanager
    def opened(self, *arguments: Any) -> Iterator[Connection]:
        unit, log = self.task.cell.unit, arguments[-1]
        with WireLog(log, self.clock) as wire, Mars(self.line, unit, self.clock, wire) as mars:
            yield Connection(mars, self.camera, 1.0, self.simulated, self.emulator)

    def stopped(self, run: Callable[[], Any], step: str, share: float) -> Path:
        self.stop_at = (step, share)
        with pytest.raises(ExecutionStopped, match="aborted on request") as stopped:
            run()
        self.stop_at = ("", 2.0)
        return Path(stopped.value.data["resume_with"])

    def first(self) -> dict[str, Any]:
        return execute_plan(
            self.plan, self.task.file, Console(), WhichCell("/dev/mars"), self.folder / "first"
        )

    def resumed(self, plan: Path, name: str) -> dict[str, Any]:
        return resume_plan(plan, self.task.file, Console(), WhichCell("/dev/mars"), self.folder / name)
