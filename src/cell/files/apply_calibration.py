"""Enter a calibration in a cell file: one key changes, everything else stays as its user wrote it.

No library puts a new key where a person would: tomlkit, which keeps comments, puts it between the first table and that
table's comment (python-poetry/tomlkit#7). So this module tries several edits of the text and takes the first one that
`tomllib` reads as the old content with this key.
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
from arm.io.toml_reader import read_toml
from arm.io.toml_writer import toml_value
from cell.config.cell_file import read_cell

_KEY = "calibration"
_STRING = r'"""(?:[^\\]|\\.)*?"""' + r"|'''.*?'''" + r'|"(?:[^"\\\n]|\\.)*"' + r"|'[^'\n]*'"
_NAMED = re.compile(
    rf"""^[ \t]*(?:{_KEY}|"{_KEY}"|'{_KEY}')[ \t]*=[ \t]*(?P<value>{_STRING})""", re.MULTILINE | re.DOTALL
)
# A line with content, and the indented comments below it, which continue its own.
_SAYING = re.compile(r"^[ \t]*[^\s#].*(?:\n|\Z)(?:[ \t]+#.*(?:\n|\Z))*", re.MULTILINE)


def name_in(cell_file: Path, calibration: Path) -> str:
    """Return the name of a calibration file in a cell file: relative to the folder of the path that it is read by."""
    return Path(os.path.relpath(calibration.resolve(), cell_file.parent.resolve())).as_posix()


def naming(name: str) -> str:
    """Return the line of a cell file that names a calibration."""
    return f"{_KEY} = {toml_value(name)}"


def apply_calibration(cell_file: Path, calibration: Path) -> str:
    """Enter a calibration file in a cell file, or replace the one that it names; return the new line.

    Comments, line ends and file mode are kept. If `cell_file` is a link, its target is written; the name is relative to
    the link's folder, as all names in a cell file are relative to the path that it is read by.

    Raises:
        InputError: the cell file cannot be read or written, or is invalid with this calibration; it is left unchanged.
    """
    wanted = read_toml(cell_file)
    is_named = _KEY in wanted
    wanted[_KEY] = name_in(cell_file, calibration)
    value = toml_value(wanted[_KEY])
    before = read_bytes(cell_file, "TOML").decode()
    candidates = _replaced(before, value) if is_named else _added(before, value)
    after = next((text for text in candidates if _content(text) == wanted), None)
    if after is None:
        raise InputError(
            f"{cell_file}: its key {_KEY} cannot be written without changing more; the file was left as it was, so "
            f"write {_KEY} = {value} by hand",
            file=str(cell_file),
            key=_KEY,
        )
    write_atomic(cell_file, after)
    try:
        read_cell(cell_file)
    except A465Error as error:
        write_atomic(cell_file, before)
        raise InputError(
            f"{cell_file}: is invalid with {calibration}: {error}; it was left as it was", **error.data
        ) from error
    return naming(wanted[_KEY])


def _replaced(text: str, value: str) -> Iterator[str]:
    """Yield the text with the value replaced at each apparent place of the key."""
    for named in _NAMED.finditer(text):
        yield text[: named.start("value")] + value + text[named.end("value") :]


def _added(text: str, value: str) -> Iterator[str]:
    """Yield the text with a new line for the key after each line with content, the last one first, then at its head."""
    end = "\r\n" if "\r\n" in text else "\n"
    for place in (*reversed([line.end() for line in _SAYING.finditer(text)]), 0):
        head = text[:place]
        between = "" if head.endswith("\n") or not head else end
        yield f"{head}{between}{_KEY} = {value}{end}{text[place:]}"


def _content(text: str) -> dict[str, Any] | None:
    """Return the content of a TOML text, or None if it is invalid."""
    try:
        return tomllib.load(io.BytesIO(text.encode()))
    except ValueError:
        return None
