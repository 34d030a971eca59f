"""Enter a calibration or a background in a cell file: one key changes, everything else stays as its user wrote it."""

from __future__ import annotations

import os
from pathlib import Path

from arm.errors import A465Error, InputError
from arm.io.storage import read_bytes, write_atomic
from arm.io.toml_edit import content, place_of
from arm.io.toml_reader import read_toml
from arm.io.toml_writer import toml_value
from cell.config.cell_file import read_cell


def name_in(cell_file: Path, calibration: Path) -> str:
    """Return the name of a calibration file in a cell file: relative to the folder of the path that it is read by."""
    return Path(os.path.relpath(calibration.resolve(), cell_file.parent.resolve())).as_posix()


def naming(name: str, key: str = "calibration") -> str:
    """Return the line of a cell file that names a calibration, or the file of another key."""
    return f"{key} = {toml_value(name)}"


def apply_calibration(cell_file: Path, calibration: Path, key: str = "calibration") -> str:
    """Enter a calibration file in a cell file, or replace the one that it names; return the new line.

    `key` is the top-level key of the cell file that names the file.

    Comments, line ends and file mode are kept. If `cell_file` is a link, its target is written; the name is relative to
    the link's folder, as all names in a cell file are relative to the path that it is read by.

    Raises:
        InputError: the cell file cannot be read or written, or is invalid with this calibration; it is left unchanged.
    """
    wanted = read_toml(cell_file)
    wanted[key] = name_in(cell_file, calibration)
    line = naming(wanted[key], key)
    before = read_bytes(cell_file, "TOML").decode()
    place = place_of(before, [key])
    after = "" if place is None else place.set(before, wanted[key])
    if content(after) != wanted:
        raise InputError(
            f"{cell_file}: its key {key} cannot be written without changing more; the file was left as it was, so "
            f"write {line} by hand",
            file=str(cell_file),
            key=key,
        )
    write_atomic(cell_file, after)
    try:
        read_cell(cell_file)
    except A465Error as error:
        write_atomic(cell_file, before)
        why = f"{cell_file}: is invalid with {calibration}: {error}; it was left as it was"
        raise InputError(why, **error.data) from error
    return line
