"""JSON values with their file and key, for files that are read from the outside in."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import FileInputError
from arm.io.storage import read_json
from arm.se3 import Array, frozen

LARGEST = 1e9  # of any number in a file; lengths, angles, pixels and counts are smaller
_SHOWN = 60  # characters of a value in a message
_UNREADABLE = {
    "Cc": "a control character",
    "Cs": "half a surrogate pair",
    "Zl": "a line end",
    "Zp": "a line end",
}


@dataclass(frozen=True)
class JsonNode:
    """A value with its file and key.

    Attributes:
        path: the file.
        key: such as ``poses[3].joints_rad``; "" for the whole file.
        value: the parsed value.
    """

    path: Path
    key: str
    value: Any

    @classmethod
    def of_file(cls, path: Path) -> JsonNode:
        """Read a whole file.

        Raises:
            InputError: it cannot be read, or is not JSON.
        """
        return cls(path, "", read_json(path))

    def error(self, rule: str) -> FileInputError:
        """Return the error to raise if the value breaks `rule`."""
        shown = None if isinstance(self.value, dict | list) or len(repr(self.value)) > _SHOWN else self.value
        return FileInputError(self.path, self.key, shown, rule)

    def __contains__(self, name: str) -> bool:
        return isinstance(self.value, dict) and name in self.value

    def __getitem__(self, name: str) -> JsonNode:
        shown = name if name.isprintable() else ascii(name)[1:-1]  # a name from the file may be anything
        key = f"{self.key}.{shown}" if self.key else shown
        if not isinstance(self.value, dict):
            raise self.error("must be an object")
        if name not in self.value:
            raise FileInputError(self.path, key, None, "is missing")
        return JsonNode(self.path, key, self.value[name])

    def items(self) -> list[JsonNode]:
        """Return the values of a list."""
        if not isinstance(self.value, list):
            raise self.error("must be a list")
        return [JsonNode(self.path, f"{self.key}[{i}]", v) for i, v in enumerate(self.value)]

    def numbers(self, *shape: int | None, gaps: bool = False) -> Array:
        """Return an array of finite numbers up to `LARGEST`.

        Args:
            shape: lengths of the axes; None for any length but 0.
            gaps: whether null may replace a number; it becomes NaN.
        """
        array = self._array()
        fits = array.ndim == len(shape) and all(
            n == m or (m is None and n > 0) for n, m in zip(array.shape, shape, strict=True)
        )
        if not fits or np.isinf(array).any() or (np.isnan(array).any() and not gaps):
            wanted = " x ".join("n" if m is None else str(m) for m in shape)
            what = f"{wanted} finite numbers" if shape else "a finite number"
            raise self.error(f"must be {what}" + (", or null" if gaps else ""))
        for place in np.argwhere(np.abs(array) > LARGEST):
            raise self._at(place).error(f"must be from {-LARGEST:g} to {LARGEST:g}")
        return frozen(array)

    def _at(self, place: Iterable[int]) -> JsonNode:
        """Return a value in nested lists."""
        node = self
        for i in place:
            node = node.items()[i]
        return node

    def _array(self) -> Array:
        """Return the numbers, NaN for null; an empty array if there is anything else, such as texts."""
        try:
            raw = np.array(self.value, dtype=object)
            flat = [_float(v) for v in raw.ravel()]
        except (TypeError, ValueError):  # rows of different lengths
            return np.zeros(0)
        return np.array(flat).reshape(raw.shape)

    def integer(self, low: int, high: int) -> int:
        """Return an integer from `low` to `high`."""
        if isinstance(self.value, bool) or not isinstance(self.value, int) or not low <= self.value <= high:
            raise self.error(f"must be a whole number from {low} to {high}")
        return self.value

    def text(self, *choices: str) -> str:
        """Return a text of one line, one of `choices` if any are given."""
        if not isinstance(self.value, str) or (choices and self.value not in choices):
            raise self.error(f"must be {'one of ' + ', '.join(choices) if choices else 'a text'}")
        for at, character in enumerate(self.value):
            if (what := _UNREADABLE.get(unicodedata.category(character))) is not None:
                raise self.error(f"must be a text of one line; character {at} is {what}")
        return self.value


def _float(value: object) -> float:
    """Return a number, NaN for null.

    Raises:
        TypeError: the value is neither.
    """
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(value)
    try:
        return float(value)
    except OverflowError:  # an integer of more than 308 digits
        return 2.0 * LARGEST if value > 0 else -2.0 * LARGEST
