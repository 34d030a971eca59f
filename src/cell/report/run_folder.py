"""The folder of a run: one run has it, and no other, also where several begin at the same moment."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from arm.errors import InputError
from arm.io.temporary import remove_abandoned

LOG = "wire.jsonl"
RUNS = Path("runs")


def require_new_folder(asked: Path | None) -> None:
    """See that a folder that is asked for is new or empty; nothing is made.

    Raises:
        InputError: it holds something.
    """
    if asked is not None and asked.exists() and (not asked.is_dir() or any(asked.iterdir())):
        raise InputError(f"{asked}: must be a new or empty folder; runs are not mixed", folder=str(asked))


@contextmanager
def run_folder(asked: Path | None, name: str) -> Iterator[Path]:
    """A folder for a run, new or empty; removed in the end if the run wrote nothing.

    The folder is this run's from here on: making the log in it succeeds once only.

    Args:
        asked: None: ``runs/NAME-1``, ``-2`` .., the first that is not there.
        name: of the task.

    Raises:
        InputError: the folder asked for holds something, or cannot be made.
    """
    require_new_folder(asked)
    try:
        folder, made = _next(name) if asked is None else (asked, _make(asked))
        try:
            (folder / LOG).touch(exist_ok=False)
        except FileExistsError as error:
            raise InputError(
                f"{folder}: another run has just begun there; runs are not mixed", folder=str(folder)
            ) from error
    except OSError as error:
        raise InputError(
            f"{asked or RUNS}: cannot be made: {error.strerror}", folder=str(asked or RUNS)
        ) from error
    try:
        yield folder
    finally:
        with contextlib.suppress(OSError):  # not empty
            if not (folder / LOG).stat().st_size and len(list(folder.iterdir())) == 1:
                (folder / LOG).unlink()
                if made:
                    folder.rmdir()


def _make(folder: Path) -> bool:
    """Make a folder; whether it was not there before.

    Raises:
        OSError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        if folder.is_dir():
            return False
        raise
    return True


def _next(name: str) -> tuple[Path, bool]:
    """A new folder of `RUNS`. What killed runs left half written in the others is removed.

    Raises:
        OSError: it cannot be made.
    """
    RUNS.mkdir(parents=True, exist_ok=True)
    for before in RUNS.iterdir():
        if before.is_dir():
            remove_abandoned(before)
    number = 1
    while True:
        folder = RUNS / f"{name}-{number}"
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        else:
            return folder, True
