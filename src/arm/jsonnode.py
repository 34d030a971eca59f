"""A value of a JSON file that knows where it stands, for files that are read from the outside in."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import FileInputError
from arm.files import read_json
from arm.se3 import Array, frozen


@dataclass(frozen=True)
class JsonNode:
    """A value, its file and its key.

    Attributes:
        path: of the file.
        key: such as ``poses[3].joints_rad``; "" for the whole file.
        value: as the parser gave it.
    """

    path: Path
    key: str
    value: Any

    @classmethod
    def of_file(cls, path: Path) -> JsonNode:
        """The whole of a file.

        Raises:
            InputError: it cannot be read, or is no JSON.
        """
        return cls(path, "", read_json(path))

    def error(self, rule: str) -> FileInputError:
        """The error to raise: `rule` says what must be."""
        shown = None if isinstance(self.value, dict | list) else self.value
        return FileInputError(self.path, self.key, shown, rule)

    def __contains__(self, name: str) -> bool:
        return isinstance(self.value, dict) and name in self.value

    def __getitem__(self, name: str) -> JsonNode:
        key = f"{self.key}.{name}" if self.key else name
        if not isinstance(self.value, dict):
            raise self.error("must be an object")
        if name not in self.value:
            raise FileInputError(self.path, key, None, "is missing")
        return JsonNode(self.path, key, self.value[name])

    def items(self) -> list[JsonNode]:
        """The values of a list."""
        if not isinstance(self.value, list):
            raise self.error("must be a list")
        return [JsonNode(self.path, f"{self.key}[{i}]", v) for i, v in enumerate(self.value)]

    def numbers(self, *shape: int | None, gaps: bool = False) -> Array:
        """Finite numbers of a shape; a length that is None is free, but not 0.

        Args:
            shape: of the array.
            gaps: whether null may stand for a number that is not there; it becomes NaN.
        """
        array = self._array()
        fits = array.ndim == len(shape) and all(
            n == m or (m is None and n > 0) for n, m in zip(array.shape, shape, strict=True)
        )
        if not fits or np.isinf(array).any() or (np.isnan(array).any() and not gaps):
            wanted = " x ".join("n" if m is None else str(m) for m in shape)
            raise self.error(f"must be {wanted} finite numbers" + (", or null" if gaps else ""))
        return frozen(array)

    def _array(self) -> Array:
        """The numbers, NaN for null; empty where there is anything else, such as texts."""
        try:
            raw = np.array(self.value, dtype=object)
            if any(type(v) not in (int, float, type(None)) for v in raw.ravel()):
                return np.zeros(0)
            return np.asarray(raw.astype(float))
        except (TypeError, ValueError):  # rows of different lengths, numbers that are too large
            return np.zeros(0)

    def integer(self, low: int, high: int) -> int:
        """A whole number of a range."""
        if isinstance(self.value, bool) or not isinstance(self.value, int) or not low <= self.value <= high:
            raise self.error(f"must be a whole number from {low} to {high}")
        return self.value

    def text(self, *choices: str) -> str:
        """A text, one of some if they are given."""
        if not isinstance(self.value, str) or (choices and self.value not in choices):
            raise self.error(f"must be {'one of ' + ', '.join(choices) if choices else 'a text'}")
        return self.value
