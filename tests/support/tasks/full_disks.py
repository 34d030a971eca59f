"""Runs whose log cannot be written."""

from __future__ import annotations

from pathlib import Path

import cell.commands.run
from arm.io.storage import data_file
from cell.console import Console
from cell.session.connection import WhichCell

TASK = data_file("scenes/task2.toml")


def execute(port: str, images: Path) -> None:
    cell.commands.run.execute_plan(
        images.parent / "plan.json", TASK, Console(), WhichCell(port, images=images)
    )
