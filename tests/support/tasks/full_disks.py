"""Runs whose log cannot be written."""

from __future__ import annotations

from pathlib import Path

import pytest

import cell.commands.run
from arm.controller.unit import load_unit
from arm.io.storage import data_file
from arm.plan_file import Move, Plan, write_plan
from arms.count_paths import quintic
from cell.console import Console
from cell.files.task import read_task
from cell.session.connection import WhichCell

TASK = data_file("scenes/task2.toml")


def execute(port: str, images: Path) -> None:
    cell.commands.run.execute_plan(
        images.parent / "plan.json", TASK, Console(), WhichCell(port, images=images)
    )


def folder_with_plan(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to run in, with a plan. Whether the plan matches the present cell is the business of other tests."""
    monkeypatch.chdir(folder)
    (folder / "images").mkdir()
    unit = load_unit("crs93")
    start = tuple(int(c) for c in unit.counts(read_task(TASK).cell.q_start))
    move = Move("there", "transit", None, quintic(start, 20), None, 0.06, 0.02, ("palm", "table"))
    registers = unit.speed_registers, unit.acceleration_registers
    plan = Plan({"name": "x", "cubes": []}, "crs93", 1.0, *registers, (move,), {})
    write_plan(folder / "plan.json", plan)
    monkeypatch.setattr(cell.commands.run, "replayed", lambda *_: ())
    monkeypatch.setattr(cell.commands.run, "require_start_at", lambda *_: None)
    monkeypatch.setattr(
        "cell.session.connection.AWAIT_S", 0.1
    )  # no image comes: a failing test fails at once
    return folder
