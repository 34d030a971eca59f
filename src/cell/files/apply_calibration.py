"""Naming a calibration in a cell file: one key changes, all else stays as its user wrote it.

No library puts a new key where a person would: tomlkit, the one that keeps comments, puts it between the first table
and that table's comment (python-poetry/tomlkit#7). So ways to write the key are tried here, and the first one is taken
that `tomllib` reads as the old content with this key.
"""

from __future__ import annotations

import io
import os
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from arm.errors import A465Error, InputError
from arm.io.storage import read_bytes, write_atomic
from arm.io.toml_reader import TomlTable
from arm.io.toml_writer import toml_value
from cell.config.cell_file import read_cell

_KEY = "calibration"
_STRING = r'"""(?:[^\\]|\\.)*?"""' + r"|'''.*?'''" + r'|"(?:[^"\\\n]|\\.)*"' + r"|'[^'\n]*'"
_NAMED = re.compile(
    rf"""^[ \t]*(?:{_KEY}|"{_KEY}"|'{_KEY}')[ \t]*=[ \t]*(?P<value>{_STRING})""", re.MULTILINE | re.DOTALL
)
# A line that says something, with the indented comments below it, which go on with its own.
_SAYING = re.compile(r"^[ \t]*[^\s#].*(?:\n|\Z)(?:[ \t]+#.*(?:\n|\Z))*", re.MULTILINE)


def name_in(cell_file: Path, calibration: Path) -> str:
    """How a cell file has to name a calibration file: relative to the folder of the path that it is read by."""
    return Path(os.path.relpath(calibration.resolve(), cell_file.parent.resolve())).as_posix()


def naming(name: str) -> str:
    """The line of a cell file that names a calibration."""
    return f"{_KEY} = {toml_value(name)}"


def apply_calibration(cell_file: Path, calibration: Path) -> str:
    """Let a cell file name a calibration file, in place of the one that it names or new; what it says then.

    Comments, line ends and the file's mode stay. If `cell_file` is a link, the file that it leads to is written; the
    name is relative to the link's folder, as all names in a cell file are to the path that it is read by.

    Raises:
        InputError: the cell file cannot be read or written, or cannot be with this calibration; then it is as it was.
    """
    wanted = TomlTable.read(cell_file).value_dict()
    is_named = _KEY in wanted
    wanted[_KEY] = name_in(cell_file, calibration)
    value = toml_value(wanted[_KEY])
    before = read_bytes(cell_file, "TOML").decode()
    ways = _replaced(before, value) if is_named else _added(before, value)
    after = next((text for text in ways if _content(text) == wanted), None)
    if after is None:
        raise InputError(
            f"{cell_file}: its key {_KEY} cannot be written without changing more; it was left as it was, write "
            f"{_KEY} = {value} by hand",
            file=str(cell_file),
            key=_KEY,
        )
    write_atomic(cell_file, after)
    try:
        read_cell(cell_file)
    except A465Error as error:
        write_atomic(cell_file, before)
        raise InputError(
            f"{cell_file}: cannot be with {calibration}: {error}; it was left as it was", **error.data
        ) from error
    return naming(wanted[_KEY])


def _replaced(text: str, value: str) -> Iterator[str]:
    """The text with another value wherever the key seems to stand."""
    for named in _NAMED.finditer(text):
        yield text[: named.start("value")] + value + text[named.end("value") :]


def _added(text: str, value: str) -> Iterator[str]:
    """The text with a line for the key after each line that says something, the last one first, or at its head."""
    end = "\r\n" if "\r\n" in text else "\n"
    for place in (*reversed([line.end() for line in _SAYING.finditer(text)]), 0):
        head = text[:place]
        between = "" if head.endswith("\n") or not head else end
        yield f"{head}{between}{_KEY} = {value}{end}{text[place:]}"


def _content(text: str) -> dict[str, Any] | None:
    """What a file with this text says; None if it would be no TOML."""
    try:
        return tomllib.load(io.BytesIO(text.encode()))
    except ValueError:
        return None
