"""Enter a calibration or a background in a cell file: one key changes, everything else stays as its user wrote it.

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

_STRING = r'"""(?:[^\\]|\\.)*?"""' + r"|'''.*?'''" + r'|"(?:[^"\\\n]|\\.)*"' + r"|'[^'\n]*'"
# A line with content, and the indented comments below it, which continue its own.
_SAYING = re.compile(r"^[ \t]*[^\s#].*(?:\n|\Z)(?:[ \t]+#.*(?:\n|\Z))*", re.MULTILINE)


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
    is_named = key in wanted
    wanted[key] = name_in(cell_file, calibration)
    line = naming(wanted[key], key)
    before = read_bytes(cell_file, "TOML").decode()
    candidates = _replaced(before, key, wanted[key]) if is_named else _added(before, line)
    after = next((text for text in candidates if _content(text) == wanted), None)
    if after is None:
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


def _replaced(text: str, key: str, name: str) -> Iterator[str]:
    """Yield the text with the name replaced at each apparent place of the key."""
    named_at = re.compile(
        rf"""^[ \t]*(?:{key}|"{key}"|'{key}')[ \t]*=[ \t]*(?P<value>{_STRING})""", re.MULTILINE | re.DOTALL
    )
    for named in named_at.finditer(text):
        yield text[: named.start("value")] + toml_value(name) + text[named.end("value") :]


def _added(text: str, line: str) -> Iterator[str]:
    """Yield the text with a new line for the key after each line with content, the last one first, then at its head."""
    end = "\r\n" if "\r\n" in text else "\n"
    for place in (*reversed([saying.end() for saying in _SAYING.finditer(text)]), 0):
        head = text[:place]
        between = "" if head.endswith("\n") or not head else end
        yield f"{head}{between}{line}{end}{text[place:]}"


def _content(text: str) -> dict[str, Any] | None:
    """Return the content of a TOML text, or None if it is invalid."""
    try:
        return tomllib.load(io.BytesIO(text.encode()))
    except ValueError:
        return None
