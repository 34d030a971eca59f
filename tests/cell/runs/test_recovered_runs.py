"""Whole runs in a realistic cell in which cubes are not gripped or do not seat: located, taken again, and seated."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from arm.errors import ExecutionStopped
from arm.io.storage import data_file
from tasks.small import leave_cubes
from tasks.whole_run import WholeRun, run_whole
from typed.command_line import replace_in

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("recovering")]


def _run(tmp_path: Path, kind: str, faults: list[str], attempts: int = 3) -> WholeRun:
    scenes = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "realistic"
    leave_cubes(scenes, 4, 2)
    world = scenes / "task2.world.toml"
    world.write_text(f"{kind} = {json.dumps(faults)}\n" + world.read_text())
    with (scenes / "cell.toml").open("a") as cell:
        cell.write(f"\n[recovery]\nattempts = {attempts}\n")
    replace_in(scenes / "cell.toml", "speed = 0.5", "speed = 1.0")
    return run_whole(scenes / "task2.toml", tmp_path / "run")


def _seated(run: WholeRun) -> int:
    return 0 if run.simulated is None else sum(e.what == "placed" for e in run.simulated.events)


@pytest.mark.parametrize(
    ("kind", "faults"),
    [
        ("grasps", ["missed", "half"]),
        ("grasps", ["aside", "missed"]),
        ("releases", ["half", "aside"]),
        ("releases", ["rim", "high"]),
    ],
)
def test_cubes_that_were_missed_or_did_not_seat_are_taken_again(
    tmp_path: Path, kind: str, faults: list[str]
) -> None:
    run = _run(tmp_path, kind, faults)
    assert run.error is None, run.said
    assert [(row["placed"], row["at"]) for row in run.report["cubes"]] == [
        (True, row["to"]) for row in run.report["cubes"]
    ]
    assert _seated(run) == 2
    assert run.said.count("it is taken again") >= 2


def test_attempts_end_and_the_cube_is_put_back(tmp_path: Path) -> None:
    run = _run(tmp_path, "releases", ["aside", "half"], attempts=1)
    assert isinstance(run.error, ExecutionStopped), run.said
    rows = run.error.data["cubes"]
    assert [row["placed"] for row in rows] == [False, True]
    assert rows[0]["at"] == rows[0]["from"]
    assert rows[0]["remarks"][-1] == f"put back into {rows[0]['from']}"
    assert "1 of 2 cubes not confirmed" in str(run.error)


def test_a_cube_that_stays_where_it_is_does_not_keep_the_others(tmp_path: Path) -> None:
    run = _run(tmp_path, "grasps", ["aside", "missed", "missed", "missed"], attempts=1)
    assert isinstance(run.error, ExecutionStopped), run.said
    rows = run.error.data["cubes"]
    assert [row["placed"] for row in rows] == [False, True]
    assert rows[0]["at"] == f"beside {rows[0]['from']}"
    assert "taken again 1 time, and putting it back failed" in run.said
