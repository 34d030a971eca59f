"""``a465 report`` and ``a465 runs``: one table of many runs, such as those of a day; and which are kept."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from arm.errors import InputError
from arm.io.outputs import keep_page
from arm.io.storage import write_atomic
from cell.console import Console
from cell.report import kept
from cell.report.run_folder import RUNS, require_no_page_of_run
from cell.report.runs import HEADER, read_runs, runs_page, runs_to_json
from cell.session.dialogue import at_terminal, require_word, typed

PRUNE = "prune"


def report_step(folders: Sequence[Path], output: Path | None, console: Console) -> dict[str, Any]:
    """Print the runs of some folders, and what they have in common; return them as JSON types.

    Args:
        folders: run folders, or folders of run folders; empty: ``runs``.
        output: page to write; None: none.
        console: for output.

    Raises:
        InputError: a folder has no report, a file cannot be read or written, or the page is one of a run.
    """
    keep_page(output)
    require_no_page_of_run(output)
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


def runs_step(folder: Path | None, days: float | None, unasked: bool, console: Console) -> dict[str, Any]:
    """Print the run folders in a folder; remove old ones if asked, once a person has agreed.

    Args:
        folder: that contains run folders; None: ``runs``.
        days: those not written to for so many days are removed; None: none is.
        unasked: whether nobody is asked.
        console: for output.

    Raises:
        InputError: the folder cannot be read, `days` is less than one, nobody agreed, or a folder cannot be removed.
    """
    if days is not None:
        kept.require_days(days)
    if days is not None and not unasked and not at_terminal():
        raise InputError("no terminal to confirm that runs may be removed: give --yes", option="--yes")
    runs = kept.kept_runs(folder or RUNS)
    listed = runs if days is None else kept.older(runs, days, time.time())
    if listed:
        console.table(kept.HEADER, [run.row() for run in listed])
    size = f"{sum(run.size for run in listed) / 1e6:.1f} MB"
    if days is None:
        console.say(f"\n{len(runs)} runs, {size}")
        if not runs and any((folder or RUNS).iterdir()):
            console.say(f"NOTE: no folder in {folder or RUNS} has the log or the report of a run")
        return {"runs": [run.to_json() for run in runs]}
    if not listed:
        console.say(f"none of {len(runs)} runs has been left unwritten for {days:g} days: nothing is removed")
    elif not unasked:
        question = f"type {PRUNE} to remove these {len(listed)} of {len(runs)} runs, {size}:"
        require_word(
            console, question, PRUNE, typed, "nothing was removed (--yes answers in advance)", "--yes"
        )
    for run in listed:
        kept.remove(run)
    if listed:
        console.say(f"removed {len(listed)} of {len(runs)} runs, {size}")
    return {"removed": [run.to_json() for run in listed], "kept": len(runs) - len(listed)}
