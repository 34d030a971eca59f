"""HTML and SVG by Jinja templates that escape every value and refuse undefined names. Pages are self-contained."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined


def _typeset(value: Any) -> Any:
    """Write a tolerance as on paper; the terminal has ASCII. What is marked safe, as scripts' data, stays."""
    return value.replace("+-", "\N{PLUS-MINUS SIGN}") if type(value) is str else value


_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).resolve().parents[1]),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
    finalize=_typeset,
)
_NUMBER = re.compile(r"[-+]?[\d.]+(e[-+]\d+)?([ +].*)?|-?|held")
"""Matches the cells of a column of numbers, with what follows (a unit, a tolerance); empty ones included."""


@dataclass(frozen=True)
class Table:
    """A table of texts. Columns of numbers are right-aligned.

    Attributes:
        header: names of the columns.
        rows: cells, one per column.
        out: indices of the rows that are dimmed.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    out: Collection[int] = ()

    def is_text(self, column: int) -> bool:
        """Return whether a column has other cells than numbers."""
        return not all(_NUMBER.fullmatch(row[column]) for row in self.rows)

    def typeset(self, cell: str) -> str:
        """Return a cell with a minus sign where it is a negative number; the terminal has ASCII."""
        return f"\N{MINUS SIGN}{cell[1:]}" if cell[:1] == "-" and cell[1:2].isdigit() else cell


def render(template: str, **values: Any) -> str:
    """Return the text of a template, named by its path below ``cell``.

    Raises:
        jinja2.UndefinedError: the template uses a name that is not in `values`.
    """
    return _TEMPLATES.get_template(template).render(values)
