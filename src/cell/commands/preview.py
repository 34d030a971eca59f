"""``a465 preview`` of a plan, or of a log. Each branch imports only what it needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arm.io.storage import keep_apart
from cell.console import Console


def preview_file(file: Path, task: Path | None, output: Path | None, console: Console) -> dict[str, Any]:
    """Write the page of a plan or a log, as the content of the file decides; by default beside the file."""
    from driver.log.read import is_log

    keep_apart(output, file, task)
    if is_log(file):
        from cell.preview.of_log import preview_log

        return preview_log(file, task, output or file.with_suffix(".html"), console)
    from cell.commands.steps import preview_step

    return preview_step(file, task, output or file.with_suffix(".html"), console)
