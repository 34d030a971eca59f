"""Naming a calibration in a cell file: one line changes, all else stays as its user wrote it."""

from __future__ import annotations

import os
import re
from pathlib import Path

from arm.errors import A465Error, InputError
from arm.files import read_text, write_atomic
from arm.toml_write import toml_value
from cell.cellfile import read_cell

_KEY = re.compile(r"^calibration\s*=.*$", re.MULTILINE)
_TABLE = re.compile(r"^\s*\[", re.MULTILINE)


def apply_calibration(cell_file: Path, calibration: Path) -> str:
    """Let a cell file name a calibration file, in place of the one that it names or new; the line that it now has.

    Raises:
        InputError: the cell file cannot be read or written, or cannot be with this calibration; then it is as it was.
    """
    before = read_text(cell_file)
    relative = os.path.relpath(calibration.resolve(), cell_file.resolve().parent)
    line = f"calibration = {toml_value(Path(relative).as_posix())}"
    first_table = _TABLE.search(before)
    head = before[: first_table.start()] if first_table else before
    named = _KEY.search(head)
    if named:
        after = before[: named.start()] + line + before[named.end() :]
    else:
        end = len(head.rstrip("\n"))
        after = f"{before[:end]}\n{line}{before[end:] or chr(10)}"
    write_atomic(cell_file, after)
    try:
        read_cell(cell_file)
    except A465Error as error:
        write_atomic(cell_file, before)
        raise InputError(
            f"{cell_file}: cannot be with {calibration}: {error}; it was left as it was", **error.data
        ) from error
    return line
