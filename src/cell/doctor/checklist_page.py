"""The first-day checklist of a cell as an HTML page: what is ticked, by what and when, and what ticks the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arm.io.storage import write_atomic
from cell.report.html import Table, render

_HEADER = ("must be true", "state", "found", "by", "when")


def write_checklist_page(page: Path, cell: str, items: Sequence[Mapping[str, Any]]) -> None:
    """Write the page, self-contained.

    Args:
        page: file to write.
        cell: name of the cell file.
        items: data of the rows of `cell.doctor.first_day.rows_of`.

    Raises:
        InputError: it cannot be written.
    """
    left = [item for item in items if not item["ticked"]]
    render_as = {
        "title": f"First-day checklist: {cell}",
        "cell": cell,
        "left": [(item["means"], "; ".join(item["void"]), item["command"]) for item in left],
        "figures": ((f"{len(items) - len(left)} of {len(items)}", "ticked"),),
        "items": Table(
            _HEADER, [_row(item) for item in items], [i for i, x in enumerate(items) if x in left]
        ),
    }
    write_atomic(page, render("report/templates/checklist.html.j2", **render_as))


def _row(item: Mapping[str, Any]) -> tuple[str, ...]:
    state = "ticked" if item["ticked"] else "void" if item["void"] else "open"
    return (item["means"], state, *(item[name] or "-" for name in ("found", "by", "when")))
