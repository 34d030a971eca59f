"""``a465 report``: one table of many runs, such as those of a day."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from arm.io.storage import write_atomic
from cell.console import Console
from cell.report.run_folder import RUNS
from cell.report.runs import HEADER, read_runs, runs_page, runs_to_json


def report_step(folders: Sequence[Path], output: Path | None, console: Console) -> dict[str, Any]:
    """Print the runs of some folders, and what they have in common; return them as JSON types.

    Args:
        folders: run folders, or folders of run folders; empty: ``runs``.
        output: page to write; None: none.
        console: for output.

    Raises:
        InputError: a folder has no report, or a file cannot be read or written.
    """
    runs = read_runs(folders or [RUNS])
    console.table(HEADER, [run.row() for run in runs])
    found = runs_to_json(runs)
    recovered = f", {found['recovered']} of them after a fault" if found["recovered"] else ""
    console.say(
        f"\n{found['done']} of {len(runs)} runs done, {found['placed']} of {found['cubes']} cubes placed{recovered}"
    )
    for fault, count in found["faults"].items():
        console.say(f"{fault}: {count} time{'' if count == 1 else 's'}")
    for cause, count in found["causes"].items():
        console.say(f"{count} run{'' if count == 1 else 's'} ended: {cause}")
    if output is not None:
        write_atomic(output, runs_page(runs))
        console.say(f"page: {output}")
        found["page"] = str(output)
    return found
