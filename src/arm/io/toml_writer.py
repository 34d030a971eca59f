"""Values as TOML texts, for the few files that are written and not only read."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from arm.se3 import Array


def toml_lines(values: Mapping[str, Any]) -> list[str]:
    """A line for each key; values are texts, numbers, flags, dates, or lists of these."""
    return [f"{key} = {toml_value(value)}" for key, value in values.items()]


def toml_rows(matrix: Array) -> str:
    """A matrix, a line for each row, to the last bit."""
    return "[\n" + "".join(f"  {row.tolist()},\n" for row in matrix) + "]"


def toml_value(value: object) -> str:
    """One value."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        # a JSON string is a TOML basic string, but for DEL
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return str(value)  # numbers and dates
