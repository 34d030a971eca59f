"""Stopped anywhere, and gone on from there: one lasting cell, one session after the other on its controller."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cell.run
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.files import data_file
from arm.planfile import read_plan
from arm.se3 import inverse
from cell.connection import Connection
from cell.console import Console
from cell.run import execute_plan, resume_plan
from cell.simulation import SimulatedCamera, SimulatedCell
from cell.steps import look_step, plan_step
from cell.taskfile import read_task
from cell.taskrun import TaskRun
from cell.worldfile import read_world
from driver.clock import Clock
from driver.emulator import Emulator
from driver.mars import Mars
from driver.stream import Progress
from driver.wirelog import WireLog

pytestmark = pytest.mark.xdist_group("resume")
TIME_SCALE = 20.0


class LastingCell:
    """A simulated cell that outlives the sessions with its controller."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        shutil.copytree(data_file("scenes"), folder / "scenes")
        self.folder, self.file = folder, folder / "scenes/task2.toml"
        world = folder / "scenes/task2.world.toml"
        world.write_text(world.read_text().replace("cubes = [1, 2, 3, 4]", "cubes = [1, 3]"))
        self.task = read_task(self.file)
        cell_ = self.task.cell
        truth = read_world(world, cell_.boards[0].marker_size)
        self.simulated = SimulatedCell(cell_, truth)
        self.clock = Clock(TIME_SCALE)
        self.emulator = Emulator(cell_.unit, self.clock, plant=self.simulated)
        self.simulated.now_ms = self.emulator.now_ms
        self.camera = SimulatedCamera(
            self.simulated, truth.camera or cell_.camera, self.emulator.counts, cell_.dictionary
        )
        self.url = self.emulator.open_pty()
        self.stop_at: Callable[[str, float], bool] | None = None
        monkeypatch.setattr(cell.run, "open_cell", self.opened)
        plain = TaskRun._on_progress

        def on_progress(run: TaskRun, progress: Progress) -> None:
            plain(run, progress)
            if self.stop_at is not None and self.stop_at(run._step_name, progress.done / progress.total):
                run.control.abort()

        monkeypatch.setattr(TaskRun, "_on_progress", on_progress)
        self.newest = self.plan = folder / "plan.json"
        console = Console(as_json=True)
        look_step(self.file, None, None, folder / "look.json", None, console)
        plan_step(self.file, folder / "look.json", self.plan, None, console, False)

    @contextmanager
    def opened(self, *arguments: Any) -> Iterator[Connection]:
        log: Path = arguments[-1]
        with WireLog(log, self.clock) as wire, Mars(self.url, self.task.cell.unit, self.clock, wire) as mars:
            yield Connection(mars, self.camera, TIME_SCALE, self.simulated, self.emulator)

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


@pytest.fixture
def lasting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LastingCell]:
    found = LastingCell(tmp_path, monkeypatch)
    with found.emulator:
        yield found


def test_stopped_again_and_again_the_task_is_finished(lasting: LastingCell) -> None:
    at, number = lasting, [0]

    def resume() -> dict[str, Any]:
        number[0] += 1
        return resume_plan(at.newest, at.file, Console(), at.url, None, at.folder / f"resumed-{number[0]}")

    at.stopped(
        lambda: execute_plan(at.plan, at.file, Console(), at.url, folder=at.folder / "first"),
        "approach 01-02",
        0.6,
    )
    assert at.held() == []
    at.stopped(resume, "lift off", 0.4)  # half out of its hole
    assert len(at.held()) == 1
    at.stopped(resume, ": to 03-04", 0.4)  # set down, on its way across
    assert len(at.held()) == 1
    at.stopped(resume, "approach 03-04", 0.7)  # half in its new hole
    assert len(at.held()) == 1
    report = resume()
    assert all(c["placed"] for c in report["cubes"])
    assert max(c["error_mm"] for c in report["cubes"]) <= 1.0
    target = at.simulated.world.boards[1]
    truly = [c.T_base_cube for c in at.simulated.cubes(at.emulator.counts())]
    near = [
        min(
            np.linalg.norm((inverse(target.T_base_board @ target.board.T_board_hole(hole)) @ T)[:2, 3])
            for hole in range(4)
        )
        for T in truly
    ]
    assert max(near) < 1e-9
    assert not [e for e in at.simulated.events if e.what in ("pushed", "fallen", "missed")]
    assert at.emulator.violations == ()
    assert all(
        m.certified
        for p in at.folder.glob("resumed-*/*.json")
        if p.name != "report.json"
        for m in read_plan(p).moves
    )


def test_a_unit_that_lost_its_positions_is_not_resumed(lasting: LastingCell) -> None:
    with pytest.raises(ImpossibleError, match="must be homed"):
        resume_plan(lasting.plan, lasting.file, Console(), lasting.url, None, lasting.folder / "run")


def test_resuming_needs_a_controller(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--resume needs --port"):
        resume_plan(tmp_path, tmp_path, Console(), None)
