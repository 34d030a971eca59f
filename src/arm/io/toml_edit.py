"""Set one value in the text of a TOML file, so that its comments, its layout and all other values stay.

No library puts a new key where a person would: tomlkit, which keeps comments, puts it between the first table and that
table's comment (python-poetry/tomlkit#7). So this module tries several edits of the text, and takes the first one that
`tomllib` reads as the old content with this value.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from typing import Any

from arm.io.toml_writer import toml_value

_STRING = r'"""(?:[^\\]|\\.)*?"""' + r"|'''.*?'''" + r'|"(?:[^"\\\n]|\\.)*"' + r"|'[^'\n]*'"
_VALUE = re.compile(rf"{_STRING}|[^\s,\[\]{{}}#]+", re.DOTALL)
# A line with content, and the indented comments below it, which continue its own.
_SAYING = re.compile(r"^[ \t]*[^\s#].*(?:\n|\Z)(?:[ \t]+#.*(?:\n|\Z))*", re.MULTILINE)
_PROBE = "a465-probe"


@dataclass(frozen=True)
class Place:
    """Where the value of a key stands in a text, or would stand.

    Attributes:
        start, end: of what the value replaces.
        before, after: what goes around the value where the key is not in the text.
    """

    start: int
    end: int
    before: str = ""
    after: str = ""

    def with_value(self, value: Any) -> str:
        """Return what stands there instead."""
        return f"{self.before}{toml_value(value)}{self.after}"

    def set(self, text: str, value: Any) -> str:
        """Return the text with a value at this place."""
        return text[: self.start] + self.with_value(value) + text[self.end :]


def place_of(text: str, steps: Sequence[str | int]) -> Place | None:
    """Return the place of a value; of a key that is missing, below the last one of its table.

    Args:
        text: of a TOML file.
        steps: keys and places in arrays of tables, from the outermost to the key; all but the last are there.

    Returns:
        The place; None if no edit changes this value alone.
    """
    wanted: Any = tomllib.loads(text)
    *above, leaf = steps
    table = reduce(getitem, above, wanted)
    places = _replaced(text, str(leaf)) if leaf in table else _added(text, str(leaf))
    table[leaf] = _PROBE
    return next((place for place in places if content(place.set(text, _PROBE)) == wanted), None)


def content(text: str) -> dict[str, Any] | None:
    """Return the content of a TOML text, or None if it is invalid."""
    try:
        return tomllib.loads(text.encode().decode())
    except ValueError:
        return None


def _replaced(text: str, leaf: str) -> Iterator[Place]:
    """Yield where values of keys with this name may stand."""
    name = re.escape(leaf)
    for found in re.finditer(
        rf"""(?:^|[\s{{,.])(?:{name}|"{name}"|'{name}')[ \t]*=[ \t]*""", text, re.MULTILINE
    ):
        start = found.end()
        if text[start : start + 1] == "[":
            yield from (Place(start, end.end()) for end in re.compile(r"\]").finditer(text, start))
        elif value := _VALUE.match(text, start):
            yield Place(start, value.end())


def _added(text: str, leaf: str) -> Iterator[Place]:
    """Yield where a key may be added: below each line with content, the last one first, then at the head."""
    end = "\r\n" if "\r\n" in text else "\n"
    for place in (*reversed([saying.end() for saying in _SAYING.finditer(text)]), 0):
        between = "" if text[:place].endswith("\n") or not place else end
        yield Place(place, place, f"{between}{leaf} = ", end)
