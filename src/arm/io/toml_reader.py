"""Checked reading of TOML; errors state file, key, value, unit and rule."""

from __future__ import annotations

import difflib
import functools
import math
import re
import sys
import tomllib
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import A465Error, FileInputError
from arm.io.storage import read_text
from arm.numerics.products import mul
from arm.se3 import Array, frozen, orthonormalised

_REQUIRED: Any = object()
LARGEST = 1e9  # largest number in a matrix
MOST_PARTS = 16  # parts of a dotted key; those of this project have 4


class TomlTable:
    """One table of a TOML file. Each getter checks one key; `finish` refuses keys that no getter has read.

    Args:
        file: the file, for messages and relative paths.
        values: the table's content.
        prefix: the dotted name of the table in the file, with a trailing dot, or "".
    """

    def __init__(self, file: Path, values: dict[str, Any], prefix: str = "") -> None:
        self.file = file
        self.prefix = prefix
        self._values = values
        self._asked: set[str] = set()
        self._others: Callable[[], str] | None = None

    def knows(self, keys: Collection[str]) -> None:
        """Set all dotted keys of a file; the error for a missing key then names misspelt keys."""
        self._others = functools.partial(_misspelt, self._values, keys)

    @classmethod
    def read(cls, path: Path) -> TomlTable:
        """Read the root table of a file.

        Raises:
            FileInputError: the file is unreadable, or not TOML (the message has line and column).
        """
        try:
            text = read_text(path, "TOML")
            _require_short_keys(path, text)
            values = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise FileInputError(path, "", None, f"is not valid TOML: {error}") from error
        except RecursionError as error:
            raise FileInputError(path, "", None, "is nested too deeply") from error
        except ValueError as error:  # thousands of digits
            raise FileInputError(path, "", None, f"has a number that is too long: {error}") from error
        _require_integers(path, values)
        return cls(path, values)

    def error(self, key: str, rule: str, help: str = "") -> FileInputError:
        """Return the error to raise if the value of `key` breaks `rule`."""
        return FileInputError(self.file, self.prefix + key, self._values.get(key), rule, help)

    def __contains__(self, key: str) -> bool:
        self._asked.add(key)
        return key in self._values

    def _get(self, key: str, default: Any, what: str) -> Any:
        self._asked.add(key)
        if key in self._values:
            return self._values[key]
        if default is not _REQUIRED:
            return default
        guess = difflib.get_close_matches(key, list(self._values), n=1)
        others = self._others() if self._others is not None else ""
        raise FileInputError(
            self.file,
            self.prefix + key,
            None,
            f"is missing; it must be {what}",
            others or (f"the file has {self.prefix}{guess[0]}" if guess else ""),
        )

    def number(
        self,
        key: str,
        unit: str,
        low: float = -math.inf,
        high: float = math.inf,
        default: float = _REQUIRED,
    ) -> float:
        """Return a number in `unit` within [low, high]."""
        rule = f"a number in {unit}{_range(low, high)}" if unit else f"a number{_range(low, high)}"
        value = self._get(key, default, rule)
        if not _is_number(value) or not low <= value <= high:
            raise self.error(key, f"must be {rule}")
        return float(value)

    def integer(self, key: str, low: int, high: int, default: int = _REQUIRED) -> int:
        """Return an integer within [low, high]."""
        rule = f"a whole number{_range(low, high)}"
        value = self._get(key, default, rule)
        if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
            raise self.error(key, f"must be {rule}")
        return value

    def numbers(
        self,
        key: str,
        count: int,
        unit: str,
        low: float = -math.inf,
        high: float = math.inf,
        default: Sequence[float] = _REQUIRED,
    ) -> Array:
        """Return `count` numbers in `unit`, each within [low, high], read-only."""
        rule = (
            f"{count} numbers in {unit}{_range(low, high)}" if unit else f"{count} numbers{_range(low, high)}"
        )
        value = self._get(key, default, rule)
        if (
            not isinstance(value, Sequence | np.ndarray)
            or isinstance(value, str)
            or len(value) != count
            or not all(_is_number(v) and low <= v <= high for v in value)
        ):
            raise self.error(key, f"must be {rule}")
        return frozen(value)

    def integers(self, key: str, count: int, low: int, high: int) -> tuple[int, ...]:
        """Return `count` integers, each within [low, high]."""
        rule = f"{count} whole numbers{_range(low, high)}"
        value = self._get(key, _REQUIRED, rule)
        if not (
            isinstance(value, list)
            and len(value) == count
            and all(isinstance(v, int) and not isinstance(v, bool) and low <= v <= high for v in value)
        ):
            raise self.error(key, f"must be {rule}")
        return tuple(value)

    def matrix(self, key: str, rows: int, columns: int, unit: str = "") -> Array:
        """Return a matrix written as a list of rows, read-only."""
        rule = f"{rows} rows of {columns} numbers" + (f" in {unit}" if unit else "")
        value = self._get(key, _REQUIRED, rule)
        if not (
            isinstance(value, list)
            and len(value) == rows
            and all(isinstance(r, list) and len(r) == columns and all(map(_is_number, r)) for r in value)
        ):
            raise self.error(key, f"must be {rule}")
        return frozen(value)

    def rigid(self, key: str) -> Array:
        """Return a rigid transform, 4x4; one with few digits is orthonormalised, an exact one is kept to the bit."""
        T = self.matrix(key, 4, 4)
        if np.abs(T).max() > LARGEST:
            raise self.error(key, f"must be numbers from {-LARGEST:g} to {LARGEST:g}")
        exact = np.abs(mul(T[:3, :3].T, T[:3, :3]) - np.eye(3)).max() <= 1e-12
        if exact and np.linalg.det(T[:3, :3]) > 0.0 and np.array_equal(T[3], (0.0, 0.0, 0.0, 1.0)):
            return T
        try:
            return orthonormalised(T)
        except A465Error as error:
            raise self.error(key, str(error)) from error

    def text(self, key: str, choices: Sequence[str] = (), default: str = _REQUIRED) -> str:
        """Return a text, one of `choices` if any are given."""
        rule = "one of " + ", ".join(choices) if choices else "a text"
        value = self._get(key, default, rule)
        if not isinstance(value, str) or (choices and value not in choices):
            guess = difflib.get_close_matches(str(value), choices, n=1)
            raise self.error(key, f"must be {rule}", f"did you mean {guess[0]!r}?" if guess else "")
        return value

    def value(self, key: str, what: str) -> Any:
        """Return the unchecked value of a required key, for keys with special rules."""
        return self._get(key, _REQUIRED, what)

    def flag(self, key: str, default: bool = _REQUIRED) -> bool:
        """Return true or false."""
        value = self._get(key, default, "true or false")
        if not isinstance(value, bool):
            raise self.error(key, "must be true or false")
        return value

    def path(self, key: str, default: str = _REQUIRED) -> Path:
        """Return the path of an existing file, named relative to this one."""
        name = self.text(key, default=default)
        path = self.file.parent / name
        if not path.is_file():
            raise self.error(key, f"names a file that is not there: {path}")
        return path

    def table(self, key: str, required: bool = True) -> TomlTable:
        """Return a sub-table; empty if it is absent and not required."""
        value = self._get(key, _REQUIRED if required else {}, "a table")
        if not isinstance(value, dict):
            raise self.error(key, "must be a table")
        table = TomlTable(self.file, value, f"{self.prefix}{key}.")
        table._others = self._others
        return table

    def tables(self, key: str, required: bool = False) -> list[TomlTable]:
        """Return an array of tables, each named key[index]."""
        value = self._get(key, _REQUIRED if required else [], "an array of tables")
        if not isinstance(value, list) or not all(isinstance(v, dict) for v in value):
            raise self.error(key, "must be an array of tables")
        return [TomlTable(self.file, v, f"{self.prefix}{key}[{i}].") for i, v in enumerate(value)]

    def value_dict(self) -> dict[str, Any]:
        """Return all keys and values, for tables with arbitrary content."""
        self._asked.update(self._values)
        return dict(self._values)

    def finish(self) -> None:
        """Refuse unknown keys.

        Raises:
            FileInputError: a key is not known; the message suggests the nearest known one.
        """
        for key in self._values:
            if key not in self._asked:
                guess = difflib.get_close_matches(key, sorted(self._asked), n=1)
                help = (
                    f"did you mean {self.prefix}{guess[0]}?"
                    if guess
                    else f"known: {', '.join(sorted(self._asked))}"
                )
                raise self.error(key, "is not a known key", help)


def _misspelt(values: dict[str, Any], keys: Collection[str]) -> str:
    """Return a hint on the misspelt keys of a file, two levels deep; "" if there are none."""
    there = {
        f"{table}.{key}" if table else key
        for table, inner in (("", values), *((k, v) for k, v in values.items() if isinstance(v, dict)))
        for key in inner
    }
    near = {
        key: difflib.get_close_matches(key, sorted(keys), n=1, cutoff=0.8)
        for key in sorted(there - set(keys))
    }
    return "; ".join(
        f"{key} is not a known key: did you mean {guess[0]}?" for key, guess in near.items() if guess
    )


# Texts and comments. An unclosed text ends with its line, which keeps the search linear in the file's length.
_TEXT = re.compile(r'"(?:[^"\\\n]|\\.)*+"?|\'[^\'\n]*+\'?|#[^\n]*+')
_PARTS = re.compile(
    rf"(?<![\w-])[\w-]++(?:[ \t]*+\.[ \t]*+[\w-]++){{{MOST_PARTS}}}",
    re.ASCII,
)


def _require_short_keys(path: Path, text: str) -> None:
    """Require that dotted keys have at most `MOST_PARTS` parts, because `tomllib` needs memory with their square.

    Raises:
        FileInputError: a key has more; the message names the line.
    """
    # replace quoted parts by words and remove comments
    plain = _TEXT.sub(lambda found: "" if found[0].startswith("#") else "_", text)
    if (found := _PARTS.search(plain)) is not None:
        line = plain.count("\n", 0, found.start()) + 1
        raise FileInputError(path, f"line {line}", None, f"has a key of more than {MOST_PARTS} parts")


def _require_integers(path: Path, values: dict[str, Any]) -> None:
    """Require integers of at most 64 bits, as in TOML; `tomllib` accepts longer ones.

    Raises:
        FileInputError: an integer is longer; the message names the key.
    """
    every: list[tuple[str, Any]] = [("", values)]
    for key, value in every:  # the list grows in the loop
        if isinstance(value, dict):
            every += [(f"{key}.{name}" if key else name, inner) for name, inner in value.items()]
        elif isinstance(value, list):
            every += [(f"{key}[{i}]", inner) for i, inner in enumerate(value)]
        elif isinstance(value, int) and not -(2**63) <= value < 2**63:
            raise FileInputError(path, key, value, "must be a whole number of 64 bits")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def _range(low: float, high: float) -> str:
    if math.isfinite(low) and math.isfinite(high):
        return f" from {low:g} to {high:g}"
    if math.isfinite(low):
        return f" of at least {low:g}"
    return f" of at most {high:g}" if math.isfinite(high) else ""
