"""Values of TOML and JSON files with their file and key; every error states file, key, value, rule and what helps."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from arm.errors import MOST_VALUE, FileInputError
from arm.io.kind import read_kind, require_kind
from arm.io.storage import leaves, read_json
from arm.io.toml_reader import read_toml

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
REQUIRED: Any = object()


@dataclass(frozen=True)
class Rule(Generic[T_co]):
    """What a value must be (`arm.io.rules`).

    Attributes:
        words: the rule in words, such as ``a number in mm from 1 to 300``.
        read: checks a value and converts it; raises its `Node.error`.
        tables: declarations of the keys of the tables in the value (`arm.io.keys.Keys`).
    """

    words: str
    read: Callable[[Node], T_co]
    tables: tuple[Any, ...] = ()


@dataclass(frozen=True)
class Node:
    """A value with its file and key.

    Attributes:
        file: the file.
        key: such as ``tool.length_mm`` or ``poses[3].joints_rad``; "" for the whole file.
        value: the parsed value.
        help: advice for messages about broken rules and missing keys.
        unknown: which keys of the table are not known, for the same messages.
    """

    file: Path
    key: str
    value: Any
    help: str = ""
    unknown: str = ""

    @classmethod
    def of_toml(cls, path: Path, *kinds: str) -> Node:
        """Read a TOML file of one of `kinds` (names in `arm.io.kind.KINDS`).

        Raises:
            FileInputError: it cannot be read, is not TOML, or is of another kind.
        """
        return cls(path, "", read_kind(path, read_toml, *kinds))

    @classmethod
    def of_json(cls, path: Path, *kinds: str) -> Node:
        """Read a JSON file of one of `kinds` (names in `arm.io.kind.KINDS`).

        Raises:
            FileInputError: it cannot be read, is not JSON, or is of another kind.
        """
        return cls(path, "", read_kind(path, read_json, *kinds))

    def require_kind(self, *kinds: str) -> None:
        """Refuse a file of another kind, as `arm.io.kind.require_kind` does."""
        require_kind(self.file, self.value, *kinds)

    def error(self, rule: str, help: str = "") -> FileInputError:
        """Return the error to raise if the value breaks `rule`; a long value is left out, a long string shortened."""
        hidden = not self.key or (not isinstance(self.value, str) and len(repr(self.value)) > MOST_VALUE)
        every = "; ".join(filter(None, (help or self.help, self.unknown)))
        return FileInputError(self.file, self.key, None if hidden else self.value, rule, every)

    def error_at(self, name: str, rule: str, help: str = "") -> FileInputError:
        """Return the error to raise if the value of a key (dotted in a table) breaks `rule`."""
        node = self._find(name)
        return (node or self._child(name, None)).error(rule, help)

    def __contains__(self, name: str) -> bool:
        return isinstance(self.value, dict) and name in self.value

    def __getitem__(self, name: str) -> Node:
        """Return the value of a required key.

        Raises:
            FileInputError: the key is missing, or this is not a table.
        """
        if (node := self._find(name)) is None:
            raise self._child(name, None).error("is missing")
        return node

    def get(self, name: str, rule: Rule[T], default: Any = REQUIRED, known: Container[str] = ()) -> T:
        """Return the checked value of a key (dotted in a table).

        Args:
            name: the key.
            rule: what the value must be.
            default: value for a missing key, written as in the file, or None; `REQUIRED`: a missing key is an error.
            known: dotted keys, and tables, that are not meant by a missing key.

        Raises:
            FileInputError: the value breaks the rule, or is missing.
        """
        if (node := self._find(name)) is not None:
            return rule.read(node)
        if default is REQUIRED:
            guess = difflib.get_close_matches(name, [one for one in self.value if one not in known], n=1)
            near = f"the file has {self._child(guess[0], None).key}" if guess else ""
            near = near or ("the file is empty" if not (self.value or self.key) else self._below(name))
            raise self._child(name, None).error(
                f"is missing; it must be {rule.words}", self.help or ("" if self.unknown else near)
            )
        made: Any = None if default is None else rule.read(self._child(name, default))
        return made  # type: ignore[no-any-return]

    def _below(self, name: str) -> str:
        """Say that a key of a TOML file stands in one of its last tables, below which it was written; "" if not."""
        if self.key or self.file.suffix != ".toml":
            return ""
        found = next(
            (key for key, _ in leaves(self.value) if key.rpartition(".")[2] == name and "." in key), ""
        )
        return f"{found} is there: keys of the file itself stand above its first table" if found else ""

    def read(self, rule: Rule[T]) -> T:
        """Return this value, checked.

        Raises:
            FileInputError: it breaks the rule.
        """
        return rule.read(self)

    def items(self) -> list[Node]:
        """Return the values of a list; raises FileInputError if this is not one."""
        if not isinstance(self.value, list):
            single = isinstance(self.value, dict) and self.file.suffix == ".toml" and "[" not in self.key
            raise self.error("must be a list", f"write [[{self.key}]], not [{self.key}]" if single else "")
        return [
            Node(self.file, f"{self.key}[{i}]", v, self.help, self.unknown) for i, v in enumerate(self.value)
        ]

    def at(self, place: Iterable[int]) -> Node:
        """Return the value at index `place` of nested lists."""
        node = self
        for i in place:
            node = node.items()[i]
        return node

    def _child(self, name: str, value: Any) -> Node:
        shown = name if name.isprintable() else ascii(name)[1:-1]  # a file's names may have any characters
        return Node(self.file, f"{self.key}.{shown}" if self.key else shown, value, self.help, self.unknown)

    def _find(self, name: str) -> Node | None:
        """Return the value of a key (dotted in a table); None if it is missing."""
        if not isinstance(self.value, dict):
            header = self.key and self.file.suffix == ".toml" and "[" not in self.key
            raise self.error("must be a table" + (f" [{self.key}]" if header else ""))
        if name in self.value:
            return self._child(name, self.value[name])
        table, dot, rest = name.partition(".")
        return self._child(table, self.value[table])._find(rest) if dot and table in self.value else None
