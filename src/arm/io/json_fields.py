"""Checked access to the values of a JSON file; errors name the key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arm.errors import FileInputError


class JsonFields:
    """Base of readers of one file. In all methods `where` is the key of the table, with a dot at its end.

    Attributes:
        path: the file.
        help: what would help, for messages.
    """

    help = ""

    def __init__(self, path: Path) -> None:
        self.path = path

    def fail(self, key: str, value: object, rule: str) -> FileInputError:
        """Return the error to raise if the value of `key` breaks `rule`."""
        return FileInputError(self.path, key, value, rule, self.help)

    def get(self, table: object, key: str, where: str, types: type | tuple[type, ...], what: str) -> Any:
        """Return the value of a key after a check of its type; true and false are not numbers."""
        if not isinstance(table, dict):
            raise self.fail(where.rstrip("."), table, "must be a table")
        if key not in table:
            raise self.fail(where + key, None, f"is missing; must be {what}")
        value = table[key]
        accepted = types if isinstance(types, tuple) else (types,)
        if not isinstance(value, accepted) or (isinstance(value, bool) and bool not in accepted):
            raise self.fail(where + key, value, f"must be {what}")
        return value

    def integers(self, value: object, where: str, count: int | None = 6) -> tuple[int, ...]:
        """Return `count` integers of 32 bits."""
        if (
            not isinstance(value, list)
            or (count is not None and len(value) != count)
            or not all(isinstance(v, int) and not isinstance(v, bool) for v in value)
        ):
            raise self.fail(where, value, f"must be {count or 'some'} whole numbers")
        if any(abs(v) >= 2**31 for v in value):
            raise self.fail(where, value, "must fit the controller's 32-bit integers")
        return tuple(value)

    def number(self, table: object, key: str, where: str, low: float = -1e9, high: float = 1e9) -> float:
        """Return a number from `low` to `high`."""
        value = float(self.get(table, key, where, (int, float), f"a number from {low:g} to {high:g}"))
        if not low <= value <= high:
            raise self.fail(where + key, value, f"must be a number from {low:g} to {high:g}")
        return value

    def choice(self, table: object, key: str, where: str, choices: tuple[str, ...]) -> str:
        """Return one of the texts `choices`."""
        value = self.get(table, key, where, str, "one of " + ", ".join(choices))
        if value not in choices:
            raise self.fail(where + key, value, "must be one of " + ", ".join(choices))
        return str(value)
