"""The folder of a run. Each run has its own, even if several begin at the same time."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from arm.errors import InputError
from arm.io.storage import unmade
from arm.io.temporary import remove_abandoned

LOG, REPORT = "wire.jsonl", "report.json"
PICTURE = "look-{}.png"  # of each look: an image with what was found drawn over it
PAGES = ("report.html", "preview*.html")  # that a run writes
RUNS = Path("runs")
MOST_SHOWN = 4  # runs in a message


def is_run(folder: Path) -> bool:
    """Whether a folder has the log or the report of a run."""
    return (folder / LOG).is_file() or (folder / REPORT).is_file()


def log_of(run: Path) -> Path:
    """Return the log of a run folder, or the log that was given itself.

    Raises:
        InputError: the folder has none; the message names the runs in it.
    """
    if not run.is_dir() or (run / LOG).is_file():
        return run / LOG if run.is_dir() else run
    inside = [str(log.parent) for log in sorted(run.glob(f"*/{LOG}"))]
    shown = " ".join(inside[:MOST_SHOWN]) + (
        f" and {more} more" if (more := len(inside) - MOST_SHOWN) > 0 else ""
    )
    help = f"is no run; give the runs in it: {shown}" if inside else "is no run, nor is any folder in it"
    raise InputError(f"{run}: has no {LOG}: it {help}", folder=str(run), runs=inside)


def require_no_page_of_run(page: Path | None) -> None:
    """Require that a page to write would not replace one that a run wrote.

    Raises:
        InputError: it would.
    """
    if page is None or not page.exists() or not is_run(page.parent):
        return
    if any(page.match(name) for name in PAGES):
        why = (
            f"{page}: belongs to the run {page.parent}, and another page would replace it; give another name"
        )
        raise InputError(why, file=str(page))


def require_no_pictures(images: Path) -> None:
    """Require that a folder of images is not that of a run, whose pictures of looks are drawn over.

    Raises:
        InputError: it is.
    """
    if is_run(images) and any(images.glob(PICTURE.format("*"))):
        rule = (
            f"is the folder of a run: its {PICTURE.format('N')} are drawn over, and of different moments; "
            "give a folder of images by the camera"
        )
        raise InputError(f"{images}: {rule}", folder=str(images))


def require_new_folder(asked: Path | None) -> None:
    """Require that a requested folder is new or empty. Nothing is created.

    Raises:
        InputError: it is not empty.
    """
    if asked is not None and asked.exists() and (not asked.is_dir() or any(asked.iterdir())):
        raise InputError(f"{asked}: must be a new or empty folder; runs are not mixed", folder=str(asked))


@contextmanager
def run_folder(asked: Path | None, name: str) -> Iterator[Path]:
    """Create a folder for a run, or use an empty one; remove it at the end if the run wrote nothing.

    Creating the log file succeeds only once, so no other run can use the folder.

    Args:
        asked: requested folder; None: ``runs/NAME-1``, ``-2`` .., the first that does not exist.
        name: name of the task.

    Raises:
        InputError: the requested folder is not empty, or cannot be made.
    """
    require_new_folder(asked)
    if asked is not None and asked.suffix.lower() in (".html", ".htm", ".json", ".pdf"):
        rule = f"is the folder of the run, in which its page will be {asked.with_suffix('') / 'report.html'}"
        raise InputError(f"{asked}: {rule}; give a folder", folder=str(asked))
    try:
        folder = asked or _next(name)
        made = asked is None or not asked.exists()
        folder.mkdir(parents=True, exist_ok=True)
        try:
            (folder / LOG).touch(exist_ok=False)
        except FileExistsError as error:
            why = f"{folder}: another run has just begun there; runs are not mixed"
            raise InputError(why, folder=str(folder)) from error
    except OSError as error:
        why = f"{asked or RUNS}: cannot be made: {unmade(asked or RUNS, error)}"
        raise InputError(why, folder=str(asked or RUNS)) from error
    try:
        yield folder
    finally:
        with contextlib.suppress(OSError):  # not empty
            if not (folder / LOG).stat().st_size and len(list(folder.iterdir())) == 1:
                (folder / LOG).unlink()
                if made:
                    folder.rmdir()


def _next(name: str) -> Path:
    """Make a new folder in `RUNS`. Remove the temporary files of killed runs from the others.

    Raises:
        OSError: it cannot be made.
    """
    RUNS.mkdir(parents=True, exist_ok=True)
    for before in RUNS.iterdir():
        if before.is_dir():
            remove_abandoned(before)
    for number in count(1):
        folder = RUNS / f"{name}-{number}"
        with contextlib.suppress(FileExistsError):
            folder.mkdir()
            break
    return folder
