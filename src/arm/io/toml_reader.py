"""TOML files as Python values, with limits that keep any file fast and small in memory."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from arm.errors import FileInputError, shortened
from arm.io.foreign import markup, table, yaml
from arm.io.storage import leaves, read_text, require_64_bits

MOST_LINE = 100  # characters of a line that is told
MOST_PARTS = 16  # parts of a dotted key; those of this project have 4


def read_toml(path: Path) -> dict[str, Any]:
    """Return the values in a TOML file.

    Raises:
        FileInputError: the file is unreadable, or not TOML (the message has line and column).
    """
    return parse_toml(path, read_text(path, "TOML"))


def parse_toml(path: Path, text: str) -> dict[str, Any]:
    """Return the values in a text of TOML; `path` is for messages.

    Raises:
        FileInputError: it is not TOML.
    """
    try:
        _require_short_keys(path, text)
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        if text.lstrip().startswith(("{", '[{"')):
            rule = (
                "is JSON, such as a look or a plan, and a TOML file belongs here (are two arguments swapped?)"
            )
            raise FileInputError(path, "", None, rule) from error
        if foreign := markup(text) or table(text) or yaml(text):
            raise FileInputError(path, "", None, f"{foreign}, and a TOML file belongs here") from error
        raise FileInputError(
            path, "", None, f"is not valid TOML: {error}{_place(text, str(error))}"
        ) from error
    except RecursionError as error:
        raise FileInputError(path, "", None, "is nested too deeply") from error
    except ValueError as error:  # thousands of digits
        raise FileInputError(path, "", None, f"has a number that is too long: {error}") from error
    for key, value in leaves(values):
        require_64_bits(path, key, value)
    return values


# Strings and comments. An unclosed string ends with its line, which keeps the search linear in the file's length.
_TEXT = re.compile(r'"(?:[^"\\\n]|\\.)*+"?|\'[^\'\n]*+\'?|#[^\n]*+')
_PARTS = re.compile(rf"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++){{{MOST_PARTS}}}", re.ASCII)


def _require_short_keys(path: Path, text: str) -> None:
    """Require dotted keys of at most `MOST_PARTS` parts, because the memory of `tomllib` grows with their square.

    Raises:
        FileInputError: a key has more; the message names the line.
    """
    # replace quoted parts by words and remove comments
    plain = _TEXT.sub(lambda found: "" if found[0].startswith("#") else "_", text)
    if (found := _PARTS.search(plain)) is not None:
        line = plain.count("\n", 0, found.start()) + 1
        raise FileInputError(path, f"line {line}", None, f"has a key of more than {MOST_PARTS} parts")


_KEY = re.compile(r"\s*([\w.\"'-]+)\s*=")
_HEADER = re.compile(r"\s*(\[[^]]+\]\]?)\s*(?:#.*)?")


def _twice(lines: list[str], number: int) -> str:
    """Return that the key of a line stands above it in the same table; "" if it does not."""
    if (key := _KEY.match(lines[number - 1])) is None:
        return ""
    for above in range(number - 2, -1, -1):
        if _HEADER.fullmatch(lines[above]):
            return ""
        if (other := _KEY.match(lines[above])) is not None and other[1] == key[1]:
            headers = (_HEADER.fullmatch(line) for line in reversed(lines[:above]))
            table = next(
                (f"in its table {header[1]}" for header in headers if header), "above the first table"
            )
            return f" ({key[1]} is there twice {table}, first in line {above + 1}; remove one of both)"
    return ""


def _without_comma(lines: Sequence[str], number: int) -> int:
    """Return the number of the line before line `number` that has a value and does not end in a comma; 0 if it does."""
    for before in range(number - 1, 0, -1):
        line = lines[before - 1].partition("#")[0].strip()
        if line:
            return 0 if line.endswith((",", "[", "{", "=")) else before
    return 0


def _place(text: str, error: str) -> str:
    """Return the line that an error of `tomllib` names, with what is often wrong in such a line; "" without one."""
    lines = text.rstrip().split("\n")
    if (found := re.search(r"at line (\d+), ", error)) is not None:
        number = int(found[1])
    elif error.endswith("(at end of document)") and "overwrite" in error:
        number = len(lines)
    else:
        return ""
    line = lines[number - 1].strip() if number <= len(lines) else ""
    help = _twice(lines, number) if "overwrite" in error else ""
    value = line.partition("=")[2].partition("#")[0].strip()
    if re.search(r"=\s*-?\d+,\d", line):
        help = " (the decimal sign is a point)"
    elif re.search(r"[\d.]\s+-?[\d.]", value) and value.startswith("["):
        help = " (numbers of a list are separated by commas)"
    elif (header := re.fullmatch(r"\[+([\w-]+)\]+", line)) and ("twice" in error or line.startswith("[[")):
        help = f" ({header[1]} stands above already; tables of which there may be several are written [[{header[1]}]])"
    elif re.search("[\u2018-\u201f]", value):
        help = ' (quotation marks are straight: ")'
    elif re.fullmatch(r"-?[\d.]+\s*[A-Za-z%\u00b0\u00b5/]+", value):
        help = " (the value is the number alone; its unit is part of the key's name)"
    elif re.match(r"[\w-]+\s*:", line) or value.startswith("="):
        help = " (a key and its value are separated by one =)"
    elif "Unclosed array" in error and (open_ := _without_comma(lines, number)):
        help = f" (a comma is missing at the end of line {open_})"
    elif re.search(r"=\s*[^\W\d]", line) and "Invalid value" in error:
        help = " (text stands in quotation marks)"
    return f": {shortened(line, MOST_LINE)}{help}" if line else ""
