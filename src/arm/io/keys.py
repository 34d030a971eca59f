"""Keys of a file, declared once: fields of a dataclass made by `key`.

`Keys.read` reads a file by them. `cell.texts.key_texts` makes the comments of a new file and the rows of
docs/formats.md from them.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self, TypeVar, dataclass_transform, overload

from arm.io.node import REQUIRED, Node, Rule

T = TypeVar("T")


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

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def declared(cls) -> dict[str, Key]:
        """Return the keys by field."""
        return {f.name: f.metadata["key"] for f in fields(cls) if "key" in f.metadata}  # type: ignore[arg-type]

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
    unknown = list(_unknown(node, [one.name for one in declared.values()]))
    hints = [f"{one.key} is not a known key" + (f": {help}" if "?" in help else "") for one, help in unknown]
    hinted = replace(node, help="; ".join(filter(None, [node.help, *hints])))
    values = {name: hinted.get(one.name, one.rule, one.default) for name, one in declared.items()}
    for one, help in unknown:
        raise one.error("is not a known key", help)
    return values


def _unknown(node: Node, known: Sequence[str], prefix: str = "") -> Iterator[tuple[Node, str]]:
    """Yield the unknown keys of a table, each with advice."""
    beside = sorted(
        {name.removeprefix(prefix).partition(".")[0] for name in known if name.startswith(prefix)}
    )
    for name in node.value if isinstance(node.value, dict) else ():
        one = node[name]
        if "." not in name and any(k.startswith(f"{prefix}{name}.") for k in known):
            yield from _unknown(one, known, f"{prefix}{name}.")  # a value that is no table has none
        elif prefix + name not in known or "." in name:
            guess = difflib.get_close_matches(name, beside, n=1)
            before = one.key.removesuffix(name)
            yield one, f"did you mean {before}{guess[0]}?" if guess else f"known: {', '.join(beside)}"
