"""Files that a command may replace: neither what it reads, nor files of the project of another kind than it writes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from arm.errors import InputError
from arm.io.kind import KINDS, kind_of_file
from arm.io.storage import read_by_the_command

SUFFIXES = (".toml", ".json", ".jsonl", ".csv")  # of files that have a kind
_ENDS = {
    "plan": ".json",
    "look": ".json",
    "trajectory": ".json",
    "samples": ".csv",
    "unit record": ".json",
}  # of what commands write
_OTHERS = {  # suffixes of other formats
    *(
        ".html",
        ".htm",
        ".csv",
        ".json",
        ".jsonl",
        ".toml",
        ".yaml",
        ".yml",
        ".xml",
        ".urdf",
        ".srdf",
        ".mcap",
    ),
    *(".npy", ".npz", ".png", ".jpg", ".pdf", ".xlsx", ".xls", ".ods", ".zip"),
}
PAGES = (".html", ".htm")  # what a browser opens as a page


def keep_apart(output: Path | None, *inputs: Path | None, kind: str | None = "") -> None:
    """Refuse to overwrite an input file, or a file of the project of another kind.

    Args:
        output: file that will be written.
        inputs: files that are read.
        kind: name in `arm.io.kind.KINDS` of what is written; "" if it has none, as a page; None: the caller
            decides what is replaced.

    Raises:
        InputError: `output` is a folder, the same file as one of `inputs`, even by another name, or a file of another
            kind; or its suffix is that of another format than the kind has.
    """
    if output is None:
        return
    if output.exists():
        _require_replaceable(output, inputs, kind)
    ends = _ENDS.get(kind or "", "")
    if ends and output.suffix.lower() in _OTHERS - {ends}:
        why = f"must end in {ends}, as it is {KINDS[kind or ''].words}"
        raise InputError(f"{output}: {why}", file=str(output))


def _require_replaceable(output: Path, inputs: Sequence[Path | None], kind: str | None) -> None:
    """Require that a file which is there may be replaced; see `keep_apart`."""
    for path in inputs:
        if path is not None and path.exists() and output.samefile(path):
            raise read_by_the_command(output)
    if kind is None:
        return
    if output.is_dir():
        raise InputError(f"{output}: is a folder; give the name of a file", file=str(output))
    if output.suffix.lower() not in SUFFIXES:
        return
    found = kind_of_file(output)
    if found and found != kind:
        why = f"{output}: is {KINDS[found].words}, and something else would replace it; give another name"
        raise InputError(why, file=str(output))


def keep_page(output: Path | None, *inputs: Path | None) -> None:
    """Refuse to write an HTML page as `keep_apart` does, and by a name with the suffix of another format.

    Raises:
        InputError: see `keep_apart`; or the suffix is not one of a page.
    """
    keep_apart(output, *inputs)
    if output is not None and (fault := page_fault(output)):
        raise InputError(f"{output}: {fault}", file=str(output))


def page_fault(output: Path) -> str:
    """Return the rule that the name of a page breaks, "" if none."""
    return (
        "" if output.suffix.lower() in PAGES else f"must end in {' or '.join(PAGES)}, as it is an HTML page"
    )


def named_as_file(folder: Path) -> bool:
    """Whether the name of a folder that is to be made is that of a file, such as ``cell.urdf``."""
    return folder.suffix.lower() in _OTHERS and not folder.is_dir()
