"""``a465 check`` states the time that toppra takes for a plan beside ours, or that it gives none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from cell.commands import second_opinion as module
from plan.trajectory.second_opinion import time_again
from typed.command_line import a465

DOWN = [[1, 0, 0, 0.4], [0, -1, 0, 0.1], [0, 0, -1, 0.25], [0, 0, 0, 1]]


@pytest.fixture
def plan(scenes: Path, tmp_path: Path) -> Path:
    """A list with an approach, a dwell and a retract."""
    entry = {"T_base_tool": DOWN, "free": "rz", "approach_mm": 60, "retract_mm": 60, "dwell_s": 1.0}
    (tmp_path / "poses.json").write_text(json.dumps([entry]))
    a465("plan", scenes / "cell.toml", tmp_path / "poses.json", "-o", tmp_path / "plan.json", "--back")
    return tmp_path / "plan.json"


@pytest.mark.slow
def test_both_times_are_stated(scenes: Path, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said, _ = a465("check", plan, scenes / "cell.toml")
    assert "toppra, on a spline through the sent motion: duration " in said
    told = json.loads(a465("check", plan, scenes / "cell.toml", "--json")[0])["second_opinion"]
    assert told["unanswered"] == []
    assert told["planned_s"] == pytest.approx(sum(m["planned_s"] for m in told["motions"]))
    assert told["toppra_s"] == pytest.approx(sum(m["toppra_s"] for m in told["motions"]))
    assert told["percent"] == pytest.approx(100.0 * (told["planned_s"] / told["toppra_s"] - 1.0))
    assert np.abs([m["percent"] for m in told["motions"]]).max() < 2.0
    assert f"planned: {told['planned_s']:.2f} s ({told['percent']:+.2f} %" in said

    def silent_once(*arguments):  # type: ignore[no-untyped-def]
        monkeypatch.setattr(module, "time_again", time_again)
        raise ImpossibleError("toppra finds no timing of a path")

    monkeypatch.setattr(module, "time_again", silent_once)
    said, _ = a465("check", plan, scenes / "cell.toml")
    assert f"toppra gives no time for {told['motions'][0]['name']}" in said
