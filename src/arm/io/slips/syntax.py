"""What is often wrong in a line that is not TOML."""

from __future__ import annotations

import re
from collections.abc import Sequence

from arm.errors import shortened

MOST_LINE = 100  # characters of a line that is told
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
            return f"{key[1]} is there twice {table}, first in line {above + 1}; remove one of both"
    return ""


def _without_comma(lines: Sequence[str], number: int) -> int:
    """Return the number of the line before line `number` that has a value and does not end in a comma; 0 if it does."""
    for before in range(number - 1, 0, -1):
        line = lines[before - 1].partition("#")[0].strip()
        if line:
            return 0 if line.endswith((",", "[", "{", "=")) else before
    return 0


_ALONE = "the value is the number alone; its unit is part of the key's name"
_SLIPS = (  # what a line and an error of `tomllib` have, and what helps
    (
        "[\u201c\u201d\u201e\u201f\u00ab\u00bb\u2018\u2019\u201a]",
        "",
        'quotation marks are straight: "',
    ),
    ("[\u2013\u2014\u2212]\\s*[\\d.]", "", "the minus sign is a hyphen (-)"),
    (r"=[^#]*\d\s*°", "", _ALONE),
    (
        r"=\s*-?[\d.]+\s*(mm/s|mm|cm|m|deg|rad|ms|us|s|%|V)\s*(#.*)?$",
        "",
        _ALONE,
    ),
    (
        r"=\s*\"[^\"]*\\",
        r"escape|hex",
        "a backslash in quotation marks begins an escape: write / instead, or 'in single ones'",
    ),
    (r"=\s*\[.*[\d.]\s+-?[\d.]", "", "numbers of a list are separated by commas"),
    (r"=\s*\(", "", "a list stands in square brackets"),
    (r"=\s*-?[\d.]+(\s*,\s*-?[\d.]+){2,}\s*(#.*)?$", "", "a list stands in square brackets"),
    (r"=\s*-?\d+,\d", "", "the decimal sign is a point"),
    (r"=\s*(True|TRUE|False|FALSE)\b", "", "true and false are written in small letters"),
    (r"=\s*(null|None|nil|NULL)\b", "", "TOML has no such value: leave the key out"),
    (r"=\s*(yes|no|on|off)\b", "", "it is true or false"),
    (r"=\s*(#.*)?$", "Invalid value", "the value is missing"),
    (r"^\s*\[\s*-?[\d.]+\s*,", "", "a row of a list whose first line, KEY = [, is missing"),
    (r"=\s*\.\d|=\s*-?\d+\.(?!\d)", "", "a digit stands on both sides of the decimal point"),
    (r"=\s*-?0\d", "", "a number does not begin with a 0"),
    (r"[\[,]\s*-?0\d", "Invalid|Unclosed", "a number does not begin with a 0"),
    (r"=\s*[^\W\d]", "Invalid value", "text stands in quotation marks"),
    (r"^\s*(//|;|%)", "", "a comment begins with #"),
    (r"^\s*[\w.-]+\s*(:|==)", "", "a key and its value are separated by one ="),
)


def _slip(line: str, error: str) -> str:
    """Return what is often wrong in such a line; "" if nothing is known."""
    return next((help for has, says, help in _SLIPS if re.search(has, line) and re.search(says, error)), "")


def place_of(text: str, error: str) -> str:
    """Return the line that an error of `tomllib` names, with what is often wrong in such a line; "" without one."""
    lines = text.rstrip().split("\n")
    if (found := re.search(r"at line (\d+), ", error)) is not None:
        number = int(found[1])
    elif error.endswith("(at end of document)"):
        number = len(lines)
    else:
        return ""
    line = lines[number - 1].strip() if number <= len(lines) else ""
    help = _slip(line, error)
    if (header := _HEADER.fullmatch(line)) and ("twice" in error or line.startswith("[[")):
        name = header[1].strip("[]")
        help = f"{name} stands above already; tables of which there may be several are written [[{name}]]"
    elif "overwrite" in error:
        help = _twice(lines, number)
    elif (
        not help
        and "Unclosed array" in error
        and not _KEY.match(line)
        and (open_ := _without_comma(lines, number))
    ):
        help = f"a comma is missing at the end of line {open_}"
    return f": {shortened(line, MOST_LINE)}{f' ({help})' if help else ''}" if line else ""
