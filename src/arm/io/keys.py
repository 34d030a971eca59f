"""Keys of a file, declared once: fields of a dataclass made by `key`.

`Keys.read` reads a file by them. `cell.texts.key_texts` makes the comments of a new file and the rows of
docs/formats.md from them.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self, TypeVar, dataclass_transform, overload

from arm.io.node import REQUIRED, Node, Rule

T = TypeVar("T")
_TOP = "above the first table"
_FEW = 3  # places that are named of a key that stands elsewhere; one with more is too common for a hint
_MORE_ALIKE = 0.15  # of ratios of `difflib`


@dataclass(frozen=True)
class Key:
    """A key of a file.

    Attributes:
        name: dotted for a key of a table.
        rule: what its value must be.
        default: value for a missing key, written as in the file; None; or `REQUIRED`.
    """

    name: str
    rule: Rule[Any]
    default: Any


@overload
def key(name: str, rule: Rule[T], default: None) -> T | None: ...
@overload
def key(name: str, rule: Rule[T], default: float | str | Sequence[Any] | Mapping[str, Any] = ...) -> T: ...
def key(name: str, rule: Rule[T], default: Any = REQUIRED) -> Any:
    """Declare a field of a dataclass as a key; see `Key`."""
    return field(metadata={"key": Key(name, rule, default)})


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(key,))
class Keys:
    """Base of the declarations of a table's keys; a subclass is a frozen dataclass with keyword arguments only."""

    _FILES: ClassVar[dict[str, type[Keys]]] = {}

    def __init_subclass__(cls, file: str = "", **more: Any) -> None:
        """Declare the keys of a table; `file`: what a file of these keys is called, such as ``a cell file``."""
        super().__init_subclass__(**more)
        dataclass(frozen=True, kw_only=True)(cls)
        if file:
            Keys._FILES[file] = cls

    @classmethod
    def declared(cls) -> dict[str, Key]:
        """Return the keys by field."""
        return {f.name: f.metadata["key"] for f in fields(cls) if "key" in f.metadata}  # type: ignore[arg-type]

    @classmethod
    def names(cls) -> list[str]:
        """Return the dotted names of the keys, ``[]`` after the name of an array of tables."""
        return _names(cls.declared())

    @classmethod
    def read(cls, node: Node) -> Self:
        """Read a table; raises the errors of `read_values`."""
        return cls(**read_values(cls.declared(), node))

    def values_of(self, kind: type[Keys]) -> dict[str, Any]:
        """Return the values of the keys that a base class declares, by field."""
        return {name: getattr(self, name) for name in kind.declared()}


def read_values(declared: Mapping[str, Key], node: Node) -> dict[str, Any]:
    """Read a table by its declared keys.

    Raises:
        FileInputError: a value breaks its rule, a key is missing, or a key is unknown. Every message also
            names the unknown keys.
    """
    unknown = list(_unknown(node, [one.name for one in declared.values()], _names(declared)))
    hints = [
        f"{one.key} is not a known key" + ("" if help.startswith("known:") else f": {help}")
        for one, help in unknown
    ]
    hinted = replace(node, unknown="; ".join(filter(None, [node.unknown, *hints])))
    parts = {part for one in declared.values() for part in (one.name, one.name.partition(".")[0])}
    values = {name: hinted.get(one.name, one.rule, one.default, parts) for name, one in declared.items()}
    for one, help in unknown:
        raise one.error("is not a known key", help)
    return values


def _unknown(
    node: Node, known: Sequence[str], every: Sequence[str], prefix: str = ""
) -> Iterator[tuple[Node, str]]:
    """Yield the unknown keys of a table, each with advice; `every`: the keys with those of arrays of tables."""
    beside = sorted(
        {name.removeprefix(prefix).partition(".")[0] for name in known if name.startswith(prefix)}
    )
    for name in node.value if isinstance(node.value, dict) else ():
        one = node[name]
        if "." not in name and any(k.startswith(f"{prefix}{name}.") for k in known):
            yield from _unknown(one, known, every, f"{prefix}{name}.")  # a value that is no table has none
        elif prefix + name not in known or "." in name:
            absent = [
                other for other in beside if other not in node.value
            ]  # more likely than one that is there
            meant = _synonym(name, absent)
            guess = meant or _likelier(name, alike(name, absent), alike(name, beside))
            before = one.key.removesuffix(name)
            near = f"did you mean {before}{guess[0]}?" if guess else f"known: {', '.join(beside)}"
            home = "" if meant else _home(name, every)
            if isinstance(one.value, dict) and home == f"it belongs {_TOP}":  # no table belongs there
                home = ""
            yield one, home or near


# With which the name of a key ends.
_UNIT = re.compile(r"_(m|mm|cm|deg|rad|s|ms|us|px|mm_s|deg_s|rad_s|v|db)$")


# What other formats call one and the same, without units.
_SYNONYMS = (
    ("centre", "center", "position", "pos", "place", "origin", "xyz"),
    ("size", "dimensions", "dims", "extent", "extents"),
    ("rpy", "orientation", "rotation", "euler"),
    ("speed", "velocity", "vel"),
)


def _synonym(name: str, absent: Sequence[str]) -> list[str]:
    """Return the key, of those that are not there, for which another format has this name; none or one."""
    word = _UNIT.sub("", name.lower())
    same = next((words for words in _SYNONYMS if word in words), ())
    return [one for one in absent if _UNIT.sub("", one.lower()) in same][:1]


def _likelier(name: str, absent: list[str], there: list[str]) -> list[str]:
    """Return the key that is not there, or one that is if it is much more alike, as one that is mistyped beside it."""
    if not absent or not there:
        return absent or there
    near, nearer = (difflib.SequenceMatcher(None, name, one[0]).ratio() for one in (absent, there))
    return there if nearer > near + _MORE_ALIKE else absent


def alike(name: str, known: Sequence[str]) -> list[str]:
    """Return the known key that a name may mean, none or one: the same but for capitals or its unit, or by letters."""
    low = name.lower()
    but_for_unit = [one for one in known if _UNIT.sub("", one.lower()) == _UNIT.sub("", low)]
    exact = [one for one in known if one.lower() == low]
    return exact or but_for_unit[:1] or difflib.get_close_matches(name, known, n=1)


def _names(declared: Mapping[str, Key]) -> list[str]:
    every = declared.values()
    inner = [f"{one.name}[].{name}" for one in every for kind in one.rule.tables for name in kind.names()]
    return [*(one.name for one in every), *inner]


def _home(name: str, known: Sequence[str]) -> str:
    """Say where a key belongs that is in the wrong table or file; "" if no file has such a key."""
    found = _places(name, known)
    if not found:
        every = ((file, _places(name, kind.names())) for file, kind in Keys._FILES.items())
        found = [f"{place} of {file}" for file, places in every for place in places]
    if len(found) > _FEW:
        found = [one for one in found if one.endswith("of a cell file")]
    return f"it belongs {' or '.join(found)}" if 0 < len(found) <= _FEW else ""


def _inside(table: str, known: Sequence[str]) -> list[str]:
    """Return the keys of a table, without those of tables in it."""
    inside = (one.removeprefix(f"{table}.") for one in known if one.startswith(f"{table}."))
    return sorted({one.partition(".")[0] for one in inside})


def _places(name: str, known: Sequence[str]) -> list[str]:
    """Return the places in a file with these keys where a key or table of that name stands."""
    tables = dict[str, None]()
    for one in known:
        table, _, last = one.rpartition(".")
        if last == name:
            tables[f"in [[{table[:-2]}]]" if table.endswith("[]") else f"in [{table}]" if table else _TOP] = (
                None
            )
        elif table.partition(".")[0] == name:
            tables[f"as the table [{name}] (its keys: {', '.join(_inside(name, known))})"] = None
    return list(tables)
