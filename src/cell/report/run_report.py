"""The report of a run as files: ``report.json`` and ``report.html``."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol

from arm.errors import A465Error
from arm.io.storage import write_atomic
from cell.files.task import Task
from cell.report.cubes import CubeRow
from cell.report.run_page import KeptPlan, Picture, run_page
from cell.scene.arm_shape import arm_shape
from cell.session.connection import Connection
from driver.execution.control import Control

TO_START = "to-start"  # name of a plan that only moves to q_start


class RunRecord(Protocol):
    """The parts of a run that are reported; see `cell.task.open_run.OpenRun`."""

    task: Task
    connection: Connection
    speed: float
    folder: Path
    control: Control
    rows: list[CubeRow]
    kept: list[KeptPlan]
    pictures: list[Picture]
    began: datetime
    remarks: list[str]


def write_run_report(run: RunRecord, more: dict[str, Any]) -> None:
    """Write both files into the run's folder. `more` is added to the JSON.

    Raises:
        InputError: a file cannot be written.
    """
    report = {**run_report(run), **more}
    write_atomic(run.folder / "report.json", json.dumps(report, indent=2, allow_nan=False) + "\n")
    now = datetime.now().astimezone()
    page = run_page(run.task, report, run.pictures, run.kept, run.began, now)
    write_atomic(run.folder / "report.html", page)


def run_report(run: RunRecord) -> dict[str, Any]:
    """Return the report of a run as JSON types."""
    whole = [kept.plan for kept in run.kept if kept.name != TO_START]
    return {
        "task": run.task.name,
        "kind": run.task.kind,
        "unit": run.task.cell.unit.name,
        "cubes": [row.to_json() for row in run.rows],
        "cubes_planned": len(whole[0].task["cubes"]) if whole else 0,
        "plan_sha256": whole[0].sha256 if whole else None,
        "plans_sha256": [p.sha256 for p in whole],
        "motion_s": round(sum(p.duration_s for p in whole), 3),
        "speed": run.speed,
        "override": run.control.ceiling,
        "time_scale": run.connection.time_scale,
        "arm_shape": arm_shape(run.task.cell),
        "simulated": run.connection.simulated is not None,
        "remarks": run.remarks,
        "folder": str(run.folder),
    }


def report_of(error: A465Error) -> dict[str, Any]:
    """Return the entry of an error that ended a run."""
    kind = {
        "kind": type(error).__name__,
        "word": error.word,
        "message": str(error),
        "exit_code": error.exit_code,
    }
    known = {key: error.data[key] for key in ("failure", "advice") if key in error.data}
    return {"error": {**kind, **known}}
