"""Rows of numbers in a text, such as CSV: their cells, the names of their columns, and what a wrong cell is."""

from __future__ import annotations

import re

_UNIT = re.compile(r"(?:[_ (\[/]|^)(deg|degrees|°|rad|mm|m)[)\]]?$")  # with which the name of a column ends
_UNITS = {"degrees": "deg", "°": "deg"}
_BEGINS = re.compile(r"[-+\u2212]?\.?\d")
_DASHES = "\u2212\u2013\u2014"  # which are no minus


def cells_of(row: str) -> list[str]:
    """Return the cells of a row without its comment; a spreadsheet may quote every one."""
    return [cell for cell in re.split(r"[,;\s]+", row.partition("#")[0].replace('"', "").strip()) if cell]


def is_number(word: str) -> bool:
    """Whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def is_header(cells: list[str]) -> bool:
    """Whether the cells are names of columns: none of them is, or begins as, a number."""
    return not any(is_number(cell) or _BEGINS.match(cell) for cell in cells)


def unit_of(name: str) -> str:
    """Return the unit with which the name of a column ends, as J1_deg, J1 (deg) and J1[deg] do; "" if none."""
    found = _UNIT.search(name.lower())
    return _UNITS.get(found[1], found[1]) if found else ""


def help_of(word: str, others: int) -> str:
    """Return what may help where a word stands for a number, in a row with `others` numbers; "" if nothing is known."""
    if any(dash in word for dash in _DASHES):
        return "its minus is a dash; write -"
    if re.fullmatch(r"\d{1,4}[./-](\d{1,2}|[^\W\d]{3,})([./-]\d{0,4})?", word):
        return "did a spreadsheet make a date of it?"
    if found := re.match(r"[-+]?\d+\.?\d*(?=(?:deg|rad|mm|m|%|\u00b0)$)", word):
        return f"write the number alone: {found[0]}"
    return "rows have numbers only; names stand in a list in JSON" if others >= 6 else ""


def has_empty_cell(row: str) -> bool:
    """Whether two commas or semicolons follow each other in a row, or it begins with one."""
    return bool(re.search(r"([,;])\s*\1|^\s*[,;]", row.partition("#")[0]))


def has_decimal_commas(row: str) -> bool:
    """Whether semicolons, tabs or quotes separate numbers with decimal commas, as some spreadsheets write them."""
    if any(re.fullmatch(r"\s*[-+]?\d+,\d+\s*", cell) for cell in re.findall(r'"([^"]*)"', row)):
        return True
    cells = [cell.strip() for cell in re.split(r"[;\t]", row.partition("#")[0]) if cell.strip()]
    pairs = [bool(re.fullmatch(r"[-+]?\d+,\d+", cell)) for cell in cells]
    whole = (re.fullmatch(r"[-+]?\d+", cell) for cell in cells)
    return len(cells) > 1 and any(pairs) and all(a or b for a, b in zip(pairs, whole, strict=True))
