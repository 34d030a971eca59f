"""One lasting cell: one session after the other on its controller, stopped wherever a test says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

import cell.commands.run
from arm.errors import ExecutionStopped
from arm.plan_file import Step
from cell.commands.steps import look_step, plan_step
from cell.console import Console
from cell.files.task import read_task
from cell.files.world import read_world
from cell.session.connection import Connection
from cell.sim.camera import SimulatedCamera
from cell.sim.cell import SimulatedCell
from cell.task.run import TaskRun
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.line.memory import Tap
from driver.execution.progress import Progress
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from tasks.small import leave_cubes, small_scenes


def _scenes(folder: Path) -> Path:
    """Small scenes with two cubes."""
    scenes = small_scenes(folder)
    leave_cubes(scenes, 1, 3)
    return scenes


@cache
def _planned(task: str) -> str:
    """The plan file for what the first look shows; it is the same wherever the scenes are."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        file = _scenes(folder) / f"{task}.toml"
        look, plan = folder / "look.json", folder / "plan.json"
        look_step(file, None, None, look, None, Console(as_json=True))
        plan_step(file, look, plan, None, Console(as_json=True), False)
        return plan.read_text()


class LastingCell:
    """A simulated cell that outlives the sessions with its controller."""

    def __init__(
        self,
        folder: Path,
        monkeypatch: pytest.MonkeyPatch,
        task: str,
        options: EmulatorOptions | None = None,
        to_unit: Tap | None = None,
    ) -> None:
        scenes = _scenes(folder)
        self.folder, self.file = folder, scenes / f"{task}.toml"
        world = scenes / f"{task}.world.toml"
        self.task = read_task(self.file)
        cell_ = self.task.cell
        truth = read_world(world, cell_.boards[0].marker_size)
        self.simulated = SimulatedCell(cell_, truth)
        self.clock = SteppedClock()
        self.emulator = Emulator(
            cell_.unit, self.clock, plant=self.simulated, options=options or EmulatorOptions()
        )
        self.simulated.now_ms = self.emulator.now_ms
        self.camera = SimulatedCamera(
            self.simulated, truth.camera or cell_.camera, self.emulator.counts, cell_.dictionary
        )
        self.line, self.url = (
            self.emulator.open_line(0.0, to_unit),
            "/dev/mars",
        )  # as it is told; nothing is opened there
        self.stop_at: Callable[[str, float], bool] | None = None
        monkeypatch.setattr(cell.commands.run, "open_cell", self.opened)
        monkeypatch.setattr(cell.commands.run, "require_openable", lambda *_: None)
        plain = TaskRun._on_progress

        def on_progress(run: TaskRun, progress: Progress) -> None:
            plain(run, progress)
            if self.stop_at is not None and self.stop_at(run._step_name, progress.done / progress.total):
                run.control.abort()

        plain_step = TaskRun._on_step

        def on_step(run: TaskRun, step: Step, index: int, total: int) -> None:
            plain_step(run, step, index, total)
            if self.stop_at is not None and self.stop_at(step.name, 0.0):
                run.control.abort()

        monkeypatch.setattr(TaskRun, "_on_progress", on_progress)
        monkeypatch.setattr(TaskRun, "_on_step", on_step)
        self.newest = self.plan = folder / "plan.json"
        self.plan.write_text(_planned(task))

    @contextmanager
    def opened(self, *arguments: Any) -> Iterator[Connection]:
        log: Path = arguments[-1]
        with WireLog(log, self.clock) as wire, Mars(self.line, self.task.cell.unit, self.clock, wire) as mars:
            yield Connection(mars, self.camera, 1.0, self.simulated, self.emulator)

    def held(self) -> list[str]:
        return [c.name for c in self.simulated.cubes(self.emulator.counts()) if c.where == "jaws"]

    def stopped(self, run: Callable[[], Any], words: str, part: float) -> ExecutionStopped:
        """Run until a step with these words in its name has done that part of its segments."""
        self.stop_at = lambda name, done: words in name and done >= part
        with pytest.raises(ExecutionStopped, match="aborted on request") as stopped:
            run()
        self.stop_at = None
        assert stopped.value.data["state"]["at_rest"] is True
        self.newest = Path(stopped.value.data["resume_with"])
        return stopped.value
