"""Any key of a file with a value of any type: each spoilt copy of what a TOML or JSON file holds."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from datetime import UTC, date, datetime, time
from typing import Any

JSON: tuple[Any, ...] = (
    None,
    True,
    0,
    -7,
    10**400,
    1.5,
    float("nan"),
    1e308,
    "",
    "any",
    "\x1b[2J",
    [],
    [[]],
    [None],
    [1, "a"],
    ["a", "b", "c", "d", "e", "f"],
    [1.0] * 6,
    [[1.0] * 4] * 4,
    [{}],
    {},
    {"a": 1},
    {"a": {"b": []}},
)
TOML: tuple[Any, ...] = (
    *(value for value in JSON if value is not None and value != [None]),
    float("inf"),
    date(2026, 11, 22),
    time(12, 0),
    datetime(2026, 11, 22, 12, 0),
    datetime(2026, 11, 22, 12, 0, tzinfo=UTC),
    [date(2026, 11, 22)],
)
Key = tuple[str | int, ...]


def keys_of(value: Any, at: Key = ()) -> Iterator[Key]:
    """Every key of nested tables, and the first and the last place of every list."""
    if at:
        yield at
    inner: list[tuple[str | int, Any]] = []
    if isinstance(value, dict):
        inner = list(value.items())
    elif isinstance(value, list) and value:
        inner = [(number, value[number]) for number in sorted({0, len(value) - 1})]
    for name, below in inner:
        yield from keys_of(below, (*at, name))


def with_value(whole: Any, key: Key, value: Any) -> Any:
    """A copy with another value at a key; the original is not changed."""
    changed = copy.deepcopy(whole)
    table = changed
    for part in key[:-1]:
        table = table[part]
    table[key[-1]] = copy.deepcopy(value)
    return changed


def without(whole: Any, key: Key) -> Any:
    """A copy without a key."""
    changed = copy.deepcopy(whole)
    table = changed
    for part in key[:-1]:
        table = table[part]
    del table[key[-1]]
    return changed
