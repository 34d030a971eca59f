"""A run of a task: whatever cannot be written, how it ended is told."""

from __future__ import annotations

import errno
import json
from collections.abc import Iterator
from pathlib import Path

import pytest

import cell.commands.run
from arm.controller.segments import CountPath
from arm.controller.unit import Unit, load_unit
from arm.errors import A465Error, ExecutionStopped, InputError
from arm.plan_file import Move, Plan, write_plan
from arms.count_paths import quintic
from cell.console import OutputLost
from cell.files.task import read_task
from cell.task.run import TaskRun
from driver.emulator import Emulator
from driver.line.clock import Clock
from tasks.full_disks import TASK, execute

pytestmark = pytest.mark.xdist_group("logs")


@pytest.fixture
def unit() -> Unit:
    return load_unit("crs93")


@pytest.fixture
def emulator(unit: Unit) -> Iterator[Emulator]:
    with Emulator(unit, Clock(20.0)) as emulator:
        yield emulator


@pytest.fixture
def place(tmp_path: Path, unit: Unit, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to run in, with a plan; that it holds in the cell of now is another test's business."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "images").mkdir()
    start = tuple(int(c) for c in unit.counts(read_task(TASK).cell.q_start))
    path: CountPath = quintic(start, 20)
    move = Move("there", "transit", None, path, None, 0.06, 0.02, ("palm", "table"))
    registers = unit.speed_registers, unit.acceleration_registers
    write_plan(
        tmp_path / "plan.json", Plan({"name": "x", "cubes": []}, "crs93", 1.0, *registers, (move,), {})
    )
    monkeypatch.setattr(cell.commands.run, "replayed", lambda *_: ())
    monkeypatch.setattr(
        "cell.session.connection.AWAIT_S", 0.1
    )  # nobody brings photographs: a failing test fails at once
    monkeypatch.setattr(cell.commands.run, "require_start_at", lambda *_: None)
    return tmp_path


def test_a_report_that_cannot_be_written_does_not_hide_how_the_run_ended(
    place: Path, emulator: Emulator, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(file: Path, _: bytes | str) -> None:
        raise InputError(f"{file}: cannot be written: No space left on device")

    monkeypatch.setattr("cell.report.run_report.write_atomic", full)
    with pytest.raises(A465Error, match="new images"):
        execute(emulator.open_pty(), place / "images")
    told = capsys.readouterr()
    assert "no report: runs/task2-1/report.json: cannot be written: No space left" in told.err + told.out


def test_an_output_that_is_lost_while_the_end_is_told_does_not_hide_how_the_run_ended(
    place: Path, emulator: Emulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost(run: TaskRun) -> None:
        raise OutputLost(BrokenPipeError(errno.EPIPE, "Broken pipe"))

    def stopped(run: TaskRun, why: str) -> None:
        raise ExecutionStopped("an axis stands still")

    monkeypatch.setattr(TaskRun, "tell_rows", lost)
    monkeypatch.setattr(TaskRun, "try_look", stopped)
    with pytest.raises(ExecutionStopped, match="an axis stands still; the arm has stopped") as ended:
        execute(emulator.open_pty(), place / "images")
    assert not isinstance(ended.value, OutputLost)
    assert json.loads((place / "runs/task2-1/report.json").read_text())["error"]["exit_code"] == 4
