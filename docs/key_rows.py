"""Writes the rows of formats.md that say what the keys of each file are: `python docs/key_rows.py`."""

from __future__ import annotations

import re
from pathlib import Path

from cell.texts.key_texts import FILES, rows_of

PAGE = Path(__file__).with_name("formats.md")


def with_rows(page: str) -> str:
    """The page with the rows of today: the table of the section "Cell file", and so on."""
    for file in FILES:
        table = re.compile(
            rf"(^## {file.capitalize()} file\n(?:(?!## |\| key)[^\n]*\n)*\| key \|[^\n]*\n\|[-|]*\n)(?:\|[^\n]*\n)*",
            re.M,
        )
        rows = "".join(f"{row}\n" for row in rows_of(file).values())
        page = table.sub(lambda found, rows=rows: found[1] + rows, page, count=1)
    return page


if __name__ == "__main__":
    PAGE.write_text(with_rows(PAGE.read_text()))
