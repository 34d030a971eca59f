"""Conversion of values to TOML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from arm.se3 import Array


def toml_lines(values: Mapping[str, Any]) -> list[str]:
    """Return one line per key; values are strings, numbers, booleans, dates, or lists of these."""
    return [f"{key} = {toml_value(value)}" for key, value in values.items()]


def toml_rows(matrix: Array) -> str:
    """Return a matrix with one line per row, exact to the last bit."""
    return "[\n" + "".join(f"  {row.tolist()},\n" for row in matrix) + "]"


def toml_value(value: object) -> str:
    """Return one value as TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # a JSON string is a TOML basic string except for DEL
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return str(value)  # numbers and dates
