"""A run of a task: whatever cannot be written, how it ended is told."""

from __future__ import annotations

import errno
import json
from pathlib import Path

import pytest

from arm.errors import A465Error, ExecutionStopped, InputError
from cell.console import OutputLost
from cell.task.run import TaskRun
from driver.emulator import Emulator
from tasks.full_disks import execute

pytestmark = pytest.mark.xdist_group("logs")


def test_a_report_that_cannot_be_written_does_not_hide_how_the_run_ended(
    place: Path, emulator: Emulator, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(file: Path, _: bytes | str) -> None:
        raise InputError(f"{file}: cannot be written: No space left on device")

    monkeypatch.setattr("cell.task.open_run.write_atomic", full)
    with pytest.raises(A465Error, match="has 0 new images"):
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
