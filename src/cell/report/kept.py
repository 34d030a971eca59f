"""Run folders that are kept: what each is, when it was last written, how large it is; and removing old ones."""

from __future__ import annotations

import contextlib
import json
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.errors import InputError
from arm.io.kind import words_of
from cell.report.run_folder import REPORT, is_run

DAY = 86400.0  # s
HEADER = ("run", "written", "of", "ended", "MB")
_DIGITS = "0123456789"


@dataclass(frozen=True)
class KeptRun:
    """A folder that a command left.

    Attributes:
        folder: of the run.
        written: when a file of it was written last, s since 1970.
        of: name of the task, or of the command without one.
        ended: done, the kind of the error in a word, or "" if there is no report that can be read.
        size: of its files, bytes.
    """

    folder: Path
    written: float
    of: str
    ended: str
    size: int

    def row(self) -> tuple[str, ...]:
        """Its row of the table."""
        written = time.strftime("%Y-%m-%d %H:%M", time.localtime(self.written))
        return str(self.folder), written, self.of, self.ended or "no report", f"{self.size / 1e6:.1f}"

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        written = time.strftime("%Y-%m-%dT%H:%M:%S%z", time.localtime(self.written))
        return {
            "folder": str(self.folder),
            "written": written,
            "of": self.of,
            "ended": self.ended,
            "bytes": self.size,
        }


def kept_runs(folder: Path) -> list[KeptRun]:
    """Return the run folders in a folder, the one that was written first at the front.

    A folder counts if it has the log or the report of a run; links do not.

    Raises:
        InputError: the folder does not exist, cannot be read, or is a run itself.
    """
    if is_run(folder):
        above = folder.absolute().parent if folder.name in ("", "..") else folder.parent
        why = f"{folder}: is a run itself; give the folder that contains runs: {above}"
        raise InputError(why, folder=str(folder))
    try:
        inside = [one for one in folder.iterdir() if one.is_dir() and not one.is_symlink()]
    except NotADirectoryError as error:
        why = f"{folder}: is {words_of(folder)}; give the folder that contains runs, such as runs"
        raise InputError(why, folder=str(folder)) from error
    except OSError as error:
        why = f"{folder}: {error.strerror}; give the folder that contains runs, such as runs"
        raise InputError(why, folder=str(folder)) from error
    runs = [_kept(one) for one in inside if is_run(one)]
    return sorted(runs, key=lambda run: (run.written, run.folder))


def _kept(folder: Path) -> KeptRun:
    files = [found.lstat() for found in folder.rglob("*") if found.is_symlink() or not found.is_dir()]
    report: dict[str, Any] = {}
    with contextlib.suppress(OSError, ValueError):  # a run without a report is listed too
        read = json.loads((folder / REPORT).read_text(encoding="utf-8"))
        report = read if isinstance(read, dict) else {}
    error = report.get("error")
    ended = str(error.get("word", "stopped")) if isinstance(error, dict) else "done" if report else ""
    return KeptRun(
        folder,
        max(file.st_mtime for file in files),
        str(report.get("task", folder.name.rstrip(_DIGITS).rstrip("-"))),
        ended,
        sum(file.st_size for file in files),
    )


def require_days(days: float) -> None:
    """Refuse less than a day.

    Raises:
        InputError: `days` is less than one, so that a run in progress could be among those of that age.
    """
    if not days >= 1.0:
        raise InputError(f"--prune {days:g}: must be at least 1 day", days=days)


def older(runs: Sequence[KeptRun], days: float, now: float) -> list[KeptRun]:
    """Return the runs of which no file was written for `days` before `now`, s since 1970.

    Raises:
        InputError: see `require_days`.
    """
    require_days(days)
    return [run for run in runs if now - run.written > days * DAY]


def remove(run: KeptRun) -> None:
    """Remove the folder of a run.

    Raises:
        InputError: it cannot be removed.
    """
    try:
        shutil.rmtree(run.folder)
    except OSError as error:
        why = f"{run.folder}: cannot be removed: {error.strerror}"
        raise InputError(why, folder=str(run.folder)) from error
