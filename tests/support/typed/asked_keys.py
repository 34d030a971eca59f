"""What the readers of TOML files ask for: every key with its rule and default, seen while files are read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest.mock import patch

from arm.io import toml_reader as toml_table
from arm.io.toml_reader import TomlTable

REQUIRED, LEFT_OUT = "required", "may be left out"
_CONTAINERS = ("a table", "an array of tables")


@dataclass
class Asked:
    """Of a key: the rule as the reader's message has it, and what counts where the key is not there."""

    rule: str
    default: str


@contextmanager
def asked_keys(file: Path) -> Iterator[dict[str, Asked]]:
    """Collects the keys of a file that are asked for meanwhile, dotted, ``[]`` for any number; no names of tables."""
    asked: dict[str, Asked] = {}
    tables: set[str] = set()
    get, contains = TomlTable._get, TomlTable.__contains__

    def watched_get(table: TomlTable, key: str, default: Any, what: str) -> Any:
        name = _name(table, key)
        if table.file == file and what in _CONTAINERS:
            tables.add(name)
        elif table.file == file and not (name in asked and asked[name].rule):
            shown = REQUIRED if default is toml_table._REQUIRED else _written(default)
            optional = name in asked and shown == REQUIRED
            asked[name] = Asked(_short(what), LEFT_OUT if optional else shown)
        return get(table, key, default, what)

    def watched_contains(table: TomlTable, key: str) -> bool:
        if table.file == file:
            asked.setdefault(_name(table, key), Asked("", LEFT_OUT))
        return contains(table, key)

    with (
        patch.object(TomlTable, "_get", watched_get),
        patch.object(TomlTable, "__contains__", watched_contains),
    ):
        yield asked
    for name in tables & set(asked):
        del asked[name]


def _name(table: TomlTable, key: str) -> str:
    return re.sub(r"\[\d+\]", "[]", table.prefix + key)


def _written(default: Any) -> str:
    if isinstance(default, list | tuple):
        return "[" + ", ".join(f"{v:g}" for v in default) + "]"
    return f"{default:g}" if isinstance(default, int | float) else str(default) or '""'


def _short(rule: str) -> str:
    return "one of OpenCV's dictionaries" if rule.startswith("one of DICT_") else rule
