"""A day of runs in one report: how each ended, how many cubes were placed, what went wrong, and how long it took."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import InputError
from arm.io.kind import words_of
from arm.io.node import Node
from arm.io.rules import is_number, rule_of, same
from arm.io.storage import read_text
from cell.report.html import Table, render

REPORT = "report.json"
HEADER = (
    "run",
    "began",
    "task",
    "ended",
    "cubes",
    "placed",
    "taken again",
    "error mm",
    "planned s",
    "lasted s",
)
_CUBES = rule_of(
    "a list of cubes", lambda v: isinstance(v, list) and all(isinstance(c, dict) for c in v), same
)
_ANY = rule_of("any value", lambda v: True, same)
_SECONDS = rule_of("a number in s", is_number, float)


@dataclass(frozen=True)
class RunResult:
    """The result of one run.

    Attributes:
        folder: of the run.
        began: local time with its offset, or "" in reports of older versions.
        task: its name.
        ended: done, or the kind of the error in a word.
        why: message of the error, or "".
        cubes, placed: number of cubes that were to move, and of those that a look confirmed.
        recovered: number of cubes that were placed although something went wrong.
        faults: what went wrong with cubes, counted.
        errors_mm: distances of cubes from their holes' axes; simulated cells only.
        motion_s, lasted_s: planned motion and whole run, s; NaN if unknown. 0: nothing was planned.
    """

    folder: Path
    began: str
    task: str
    ended: str
    why: str
    cubes: int
    placed: int
    recovered: int
    faults: Counter[str]
    errors_mm: tuple[float, ...]
    motion_s: float
    lasted_s: float

    @property
    def again(self) -> int:
        """How often a cube had to be taken again, or was given up."""
        return self.faults["not gripped"] + self.faults["not confirmed"]

    def row(self) -> tuple[str, ...]:
        """Its row of the table."""
        return (
            str(self.folder),
            self.began.partition("+")[0].replace("T", " "),
            self.task,
            self.ended,
            str(self.cubes),
            str(self.placed),
            str(self.again),
            f"{max(self.errors_mm):.2f}" if self.errors_mm else "-",
            *(f"{value:.1f}" if value > 0.0 else "-" for value in (self.motion_s, self.lasted_s)),
        )


def read_runs(folders: Iterable[Path]) -> list[RunResult]:
    """Read the reports of run folders, or of the run folders in a folder, in the order of their beginnings.

    Raises:
        InputError: a folder has no report, or a report cannot be read.
    """
    found: dict[Path, RunResult] = {}
    for folder in folders:
        files = sorted(folder.glob(f"*/{REPORT}")) if not (folder / REPORT).is_file() else [folder / REPORT]
        if not files and folder.is_file():
            why = f"{folder}: is {words_of(folder)}; give folders of runs, such as runs"
            raise InputError(why, folder=str(folder))
        if not files and not folder.is_dir():
            page = f"; is it the page to write? give it with -o {folder}" if folder.suffix == ".html" else ""
            raise InputError(f"{folder}: no such folder of runs{page}", folder=str(folder))
        if not files:
            why = (
                f"{folder}: has no {REPORT}, and no folder in it has one; give folders of runs, such as runs"
            )
            raise InputError(why, folder=str(folder))
        found |= {file.parent: _read(file) for file in files}
    return sorted(found.values(), key=lambda run: (run.began, str(run.folder)))


def _read(file: Path) -> RunResult:
    try:
        value = json.loads(read_text(file))
    except ValueError as error:
        raise InputError(f"{file}: is no JSON: {error}", file=str(file)) from error
    root = Node(file, "", value)
    cubes: list[dict[str, Any]] = root.get("cubes", _CUBES)
    end = root.get("error", _ANY, None)
    end = end if isinstance(end, dict) else {}
    faults: Counter[str] = Counter()
    for cube in cubes:
        faults.update(str(fault) for fault in cube.get("faults", ()))
    return RunResult(
        file.parent,
        str(root.get("began", _ANY, "")),
        str(root.get("task", _ANY)),
        str(end.get("word", "stopped")) if end else "done",
        str(end.get("message", "")),
        max(len(cubes), int(root.get("cubes_planned", _SECONDS, 0.0))),
        sum(cube.get("placed") is True for cube in cubes),
        sum(cube.get("placed") is True and bool(cube.get("faults")) for cube in cubes),
        faults,
        tuple(float(cube["error_mm"]) for cube in cubes if is_number(cube.get("error_mm"))),
        root.get("motion_s", _SECONDS, np.nan),
        root.get("lasted_s", _SECONDS, np.nan),
    )


def runs_to_json(runs: Sequence[RunResult]) -> dict[str, Any]:
    """Return the runs, and what they have in common, as JSON types; unknown values are null."""
    return {
        "runs": [
            {
                "folder": str(run.folder),
                "began": run.began or None,
                "task": run.task,
                "ended": run.ended,
                "why": run.why or None,
                "cubes": run.cubes,
                "placed": run.placed,
                "recovered": run.recovered,
                "faults": dict(run.faults),
                "errors_mm": list(run.errors_mm),
                "motion_s": None if np.isnan(run.motion_s) else run.motion_s,
                "lasted_s": None if np.isnan(run.lasted_s) else run.lasted_s,
            }
            for run in runs
        ],
        **summary_of(runs),
    }


def summary_of(runs: Sequence[RunResult]) -> dict[str, Any]:
    """Return what runs have in common as JSON types: runs done, cubes placed, faults, causes, errors and times."""
    errors = [error for run in runs for error in run.errors_mm]
    lasted = [run.lasted_s for run in runs if run.ended == "done" and not np.isnan(run.lasted_s)]
    faults = sum((run.faults for run in runs), Counter[str]())
    return {
        "done": sum(run.ended == "done" for run in runs),
        "cubes": sum(run.cubes for run in runs),
        "placed": sum(run.placed for run in runs),
        "recovered": sum(run.recovered for run in runs),
        "faults": dict(faults.most_common()),
        "causes": dict(Counter(run.why for run in runs if run.why).most_common()),
        "error_mm": None if not errors else {"median": float(np.median(errors)), "most": max(errors)},
        "lasted_s": None if not lasted else {"median": float(np.median(lasted)), "most": max(lasted)},
    }


def runs_page(runs: Sequence[RunResult]) -> str:
    """Return the page's text, self-contained."""
    total = summary_of(runs)
    figures = [
        (f"{total['done']} of {len(runs)}", "runs done"),
        (f"{total['placed']} of {total['cubes']}", "cubes placed"),
        (str(total["recovered"]), "of these after a fault"),
    ]
    if total["error_mm"] is not None:
        figures.append((f"{total['error_mm']['median']:.2f} mm", "median error (truth)"))
        figures.append((f"{total['error_mm']['most']:.2f} mm", "largest error (truth)"))
    if total["lasted_s"] is not None:
        figures.append((f"{total['lasted_s']['median']:.0f} s", "median of a run that was done"))
    return render(
        "report/templates/runs.html.j2",
        title="runs · a465",
        figures=figures,
        runs=Table(HEADER, [run.row() for run in runs]),
        faults=Table(("fault", "cubes"), [(fault, str(n)) for fault, n in total["faults"].items()]),
        causes=Table(("why runs ended", "runs"), [(why, str(n)) for why, n in total["causes"].items()]),
    )
