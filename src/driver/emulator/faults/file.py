"""The fault file: a script of faults as TOML, one ``[[fault]]`` each."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from arm.errors import InputError
from arm.io.toml_reader import TomlTable
from driver.emulator.faults.model import DIRECTIONS, KINDS, NEEDED, USED, Fault, When

_T = TypeVar("_T", Fault, When)

_MOST = 1000  # faults per file
_TEXTS = ("axis", "direction", "text")
_WHOLE = ("byte", "line", "count", "most_counts", "queue", "seed", "segment", "nth")


def read_faults(path: Path) -> tuple[Fault, ...]:
    """Read a fault file.

    Each ``[[fault]]`` has a `kind`, the fields of that kind (`Fault`), and an optional table `when` (`When`).

    Raises:
        InputError: with file, key, value and rule.
    """
    root = TomlTable.read(path)
    tables = root.tables("fault", required=True)
    root.finish()
    if len(tables) > _MOST:
        raise root.error("fault", f"has {len(tables)} tables, must have at most {_MOST}")
    return tuple(_fault(table) for table in tables)


def _fault(table: TomlTable) -> Fault:
    kind = table.text("kind", KINDS)
    values: dict[str, Any] = {"kind": kind}
    for name in USED[kind]:  # type: ignore[index]
        required = name in NEEDED.get(kind, ())  # type: ignore[call-overload]
        if required or name in table:
            values[name] = _value(table, name)
    if "when" in table:
        values["when"] = _when(table.table("when"))
    table.finish()
    return _made(Fault, table, values)


def _when(table: TomlTable) -> When:
    values = {f.name: _value(table, f.name) for f in fields(When) if f.name in table}
    if values.get("segment") == 0:
        raise table.error("segment", "must be 1 or more")
    table.finish()
    return _made(When, table, values)


def _value(table: TomlTable, name: str) -> Any:
    if name == "direction":
        return table.text(name, DIRECTIONS)
    if name in _TEXTS or name == "command":
        return table.text(name)
    if name in _WHOLE:
        return table.integer(name, 0, 2**31)
    return table.number(name, "")


def _made(kind: type[_T], table: TomlTable, values: dict[str, Any]) -> _T:
    """Create a `kind` from the values; raise its errors with the file's name."""
    try:
        return kind(**values)
    except InputError as error:
        key = str(error.data["key"]).removeprefix("when.")
        raise table.error(
            key if key in values else next(iter(values), ""), str(error.data["rule"])
        ) from error
