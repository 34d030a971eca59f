"""What of a log is exported."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cell.console import Console
from cell.export.export import ExportOptions, export_file
from wire.logged_session import LoggedRun


def export(run: LoggedRun, form: str, path: Path, sent: bool = False) -> dict[str, Any]:
    return export_file(run.log, ExportOptions(form, path, planned=sent), Console(as_json=True))


def seconds(value: dict[str, int]) -> float:
    assert set(value) == {"sec", "nanosec"}
    assert 0 <= value["nanosec"] < 10**9
    return value["sec"] + 1e-9 * value["nanosec"]
