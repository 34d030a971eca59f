"""A run that was stopped while it took a displaced cube again is resumed: it knows where that cube is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from arm.plan_file import read_plan
from cell.commands.run import resume_plan, run_task
from cell.console import Console
from cell.session.connection import WhichCell
from wire.lasting_cell import LastingCell

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("resume")]


@pytest.mark.parametrize(
    ("fault", "words", "part", "holds"),
    [("aside", "approach beside", 0.6, 0), ("aside", ": to 03-04", 0.4, 1), ("half", "let go", 0.0, 1)],
)
def test_a_stopped_recovery_is_finished(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    fault: str,
    words: str,
    part: float,
    holds: int,
) -> None:
    at = LastingCell(tmp_path, monkeypatch, "task2")
    at.simulated._grasp_faults = [fault]
    with at.emulator:

        def first() -> dict[str, Any]:
            return run_task(at.file, Console(), WhichCell(at.url), at.folder / "first")

        at.stopped(first, words, part)
        assert at.newest.name.startswith("recovery-")
        assert len(at.held()) == holds
        assert read_plan(at.newest).task["cubes"][0]["from"].startswith("beside ")
        report = resume_plan(at.newest, at.file, Console(), WhichCell(at.url), at.folder / "second")
        assert all(c["placed"] for c in report["cubes"]), capsys.readouterr().out
        assert len(report["cubes"]) == 2
        events = [e.what for e in at.simulated.events]
        assert events.count("placed") == 2
        assert not {"fallen", "missed", "unseated", "lost"} & set(events)
        assert events.count("pushed") == 1  # by the fault
        assert at.emulator.violations == ()
