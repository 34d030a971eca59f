"""Set values in the text of a TOML file, so that its comments and all other values stay."""

from __future__ import annotations

import copy
import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arm.errors import FileInputError
from arm.io.toml_edit import Place, place_of

NOT_THERE = "is not in the file"
_POSE, BY_TAPE = (
    "T_base_camera",
    ("position_mm", "looks_at_mm", "right_azimuth_deg"),
)  # of a camera file, either
_STEP = re.compile(r"([A-Za-z0-9_-]+)|\[(\d+)\]|\.")


class Template:
    """A file whose values at some keys are set.

    Args:
        file: the file, for messages.
        text: its content.
        keys: such as ``boards[1].centre_mm[0]``. The key of a table may be missing: it is then added.

    Raises:
        FileInputError: there is no such value, or it cannot be set without changing more.
    """

    def __init__(self, file: Path, text: str, keys: Sequence[str]) -> None:
        self._text, self._keys = text, tuple(keys)
        self._places: dict[tuple[str | int, ...], Place] = {}
        self._stated: dict[tuple[str | int, ...], Any] = {}
        self._split: list[tuple[tuple[str | int, ...], tuple[int, ...]]] = []
        content = tomllib.loads(text)
        taken: list[tuple[str | int, ...]] = []
        for key in keys:
            steps = _steps(file, key)
            _require_alone(file, key, steps, taken)
            taken.append(steps)
            last = max(k for k, step in enumerate(steps) if isinstance(step, str)) + 1
            name, inside = steps[:last], tuple(step for step in steps[last:] if isinstance(step, int))
            self._split.append((name, inside))
            if name not in self._places:
                self._stated[name] = _stated(file, content, key, name)
                if inside and self._stated[name] is None:
                    raise _not_there(file, key, content, name)
                place = place_of(text, name)
                if place is None:
                    why = "cannot be set without changing more of the file"
                    raise FileInputError(file, key, None, why)
                self._places[name] = place
            _require_item(file, key, self._stated[name], inside)

    def stated(self, number: int) -> Any:
        """Return the value that the file has at a key, by its number; None if it has none."""
        name, inside = self._split[number]
        value = self._stated[name]
        for step in inside:
            value = value[step]
        return value

    def text(self, values: Sequence[Any]) -> str:
        """Return the content with these values at the keys."""
        wanted = copy.deepcopy(self._stated)
        for (name, inside), value in zip(self._split, values, strict=True):
            if not inside:
                wanted[name] = value
                continue
            items = wanted[name]
            for step in inside[:-1]:
                items = items[step]
            items[inside[-1]] = value
        parts, at = [], 0
        for name, place in sorted(self._places.items(), key=lambda one: one[1].start):
            parts += [self._text[at : place.start], place.with_value(wanted[name])]
            at = place.end
        return "".join([*parts, self._text[at:]])


def has_key(file: Path, text: str, key: str) -> bool:
    """Whether the content of a file has a value at a key.

    Raises:
        FileInputError: it is no key.
    """
    inside: Any = tomllib.loads(text)
    for step in _steps(file, key):
        if not (
            step in inside
            if isinstance(inside, dict)
            else isinstance(inside, list) and step in range(len(inside))
        ):
            return False
        inside = inside[step]
    return True


def _steps(file: Path, key: str) -> tuple[str | int, ...]:
    steps: list[str | int] = []
    at = 0
    while at < len(key):
        found = _STEP.match(key, at)
        if found is None:
            break
        if found[1] is not None:
            steps.append(found[1])
        elif found[2] is not None:
            steps.append(int(found[2]))
        at = found.end()
    if at < len(key) or not steps or not isinstance(steps[0], str):
        raise FileInputError(file, key, None, "is not a key", "write it like boards[1].centre_mm[0]")
    return tuple(steps)


def _require_alone(
    file: Path, key: str, steps: tuple[str | int, ...], taken: Sequence[tuple[str | int, ...]]
) -> None:
    """Refuse a key that is another one, is inside another, or has another inside."""
    for other in taken:
        shorter = min(len(other), len(steps))
        if other[:shorter] == steps[:shorter]:
            raise FileInputError(file, key, None, "varies twice", "name each value once")


def _require_item(file: Path, key: str, value: Any, inside: tuple[int, ...]) -> None:
    for step in inside:
        if not isinstance(value, list) or step >= len(value):
            help = "write the whole list into the file first; its items are counted from 0"
            raise FileInputError(file, key, None, NOT_THERE, help)
        value = value[step]


def _not_there(
    file: Path, key: str, content: Mapping[str, Any], name: tuple[str | int, ...]
) -> FileInputError:
    """Say that an item varies of a list that is not in the file."""
    table: Any = content
    for step in name[:-1]:
        table = table[step]
    guess = difflib.get_close_matches(str(name[-1]), table, n=1)
    help = (
        f"did you mean {guess[0]}?"
        if guess
        else f"it has {_names(table)}; write the whole list into it first"
    )
    if _POSE in table and str(name[-1]) in BY_TAPE:
        help = f"it has {_POSE}; write {', '.join(BY_TAPE)} instead of it first: docs/formats.md, camera file"
    return FileInputError(file, key, None, NOT_THERE, help)


def _stated(file: Path, content: Mapping[str, Any], key: str, name: tuple[str | int, ...]) -> Any:
    """Return the value of a key, or None if its table is there and it is not."""
    table: Any = content
    for step in name[:-1]:
        known = isinstance(table, list) and isinstance(step, int) and step < len(table)
        if not known and not (isinstance(table, dict) and step in table):
            more = "" if isinstance(table, list) and table else "; write the table into the file first"
            help = f"it has {_names(table)}{more}"
            raise FileInputError(file, key, None, NOT_THERE, help)
        table = table[step]
    if not isinstance(table, dict):
        raise FileInputError(file, key, None, NOT_THERE, f"it has {_names(table)}")
    value = table.get(str(name[-1]))
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(v, dict) for v in value)):
        raise FileInputError(file, key, None, "is a table; only single values and lists vary")
    return value


def _names(table: Any) -> str:
    if isinstance(table, list):
        last = f": the last is [{len(table) - 1}]" if table else ""
        return f"{len(table)} of them, counted from 0{last}"
    return ", ".join(table) if isinstance(table, dict) else "a value there"
