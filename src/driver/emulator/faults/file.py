"""The fault file: a script of faults as TOML, one ``[[fault]]`` each."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any, TypeVar

from arm.errors import InputError
from arm.io.keys import Key, read_values
from arm.io.node import REQUIRED, Node, Rule
from arm.io.rules import integer, number, tables, text
from driver.emulator.faults.model import DIRECTIONS, KINDS, NEEDED, USED, Fault, When

_T = TypeVar("_T", Fault, When)

_MOST = 1000  # faults per file
_TEXTS = ("kind", "axis", "direction", "text", "command")
_WHOLE = ("byte", "line", "count", "most_counts", "queue", "seed", "segment", "nth")


def read_faults(path: Path) -> tuple[Fault, ...]:
    """Read a fault file.

    Each ``[[fault]]`` has a `kind`, the fields of that kind (`Fault`), and an optional table `when` (`When`).

    Raises:
        InputError: with file, key, value and rule.
    """
    root = Node.of_toml(path, "faults")
    faults: tuple[Fault, ...] = read_values({"fault": Key("fault", tables(_fault), REQUIRED)}, root)["fault"]
    if len(faults) > _MOST:
        raise root.error_at("fault", f"has {len(faults)} tables, must have at most {_MOST}")
    return faults


def _fault(node: Node) -> Fault:
    kind = node.get("kind", text(*KINDS))
    needed = NEEDED.get(kind, ())  # type: ignore[call-overload]
    declared = {name: _key(name, name in needed) for name in USED[kind]}  # type: ignore[index]
    declared |= {"kind": _key("kind", True), "when": Key("when", Rule("a table", _when), None)}
    return _made(Fault, node, read_values(declared, node))


def _when(node: Node) -> When:
    values = read_values({f.name: _key(f.name, False) for f in fields(When)}, node)
    if values["segment"] == 0:
        raise node.error_at("segment", "must be 1 or more")
    return _made(When, node, values)


def _key(name: str, required: bool) -> Key:
    rule: Rule[Any] = number()
    if name in _TEXTS:
        rule = text(*(DIRECTIONS if name == "direction" else ()))
    elif name in _WHOLE:
        rule = integer(0, 2**31)
    return Key(name, rule, REQUIRED if required else None)


def _made(kind: type[_T], node: Node, values: dict[str, Any]) -> _T:
    """Create a `kind` from the values that are given; raise its errors with the file's name."""
    given = {name: value for name, value in values.items() if value is not None}
    try:
        return kind(**given)
    except InputError as error:
        key = str(error.data["key"]).removeprefix("when.")
        place = key if key in given else next(iter(given), "")
        raise node.error_at(place, str(error.data["rule"])) from error
