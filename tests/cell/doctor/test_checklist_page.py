"""The page of the checklist says what is ticked, by what and when, and what ticks the rest."""

from __future__ import annotations

from html import unescape
from pathlib import Path

import pytest

from cell.config.cell_file import read_cell
from cell.doctor.checklist import ITEMS, tick_of, write_ticks
from cell.doctor.checklist_page import write_checklist_page
from cell.doctor.first_day import rows_of
from pages.browsers import require_fit
from typed.command_line import replace_in

pytestmark = pytest.mark.xdist_group("doctor")


def page_of(file: Path) -> str:
    page = file.with_name("page.html")
    write_checklist_page(page, "my cell", [row.data for row in rows_of(read_cell(file), {})])
    return unescape(page.read_text())


@pytest.mark.slow
def test_the_page_fits(scenes: Path, tmp_path: Path) -> None:
    require_fit(page_of(scenes / "cell.toml"), tmp_path, "first-day")


def test_a_page_of_open_void_and_ticked_items(scenes: Path) -> None:
    file = scenes / "cell.toml"
    cell = read_cell(file)
    open_page = page_of(file)
    assert "0 of 6" in open_page
    assert all(item.means in open_page and item.command(cell) in open_page for item in ITEMS)
    ticks = {item.name: tick_of(cell, item.name, "port <b>", f"found {item.name}") for item in ITEMS}
    write_ticks(file, ticks)
    whole = page_of(file)
    assert "6 of 6" in whole
    assert ">complete<" in whole
    assert "a465 doctor" not in whole
    assert all(f"found {name}" in whole and tick.when in whole for name, tick in ticks.items())
    assert "port &lt;b&gt;" in file.with_name("page.html").read_text()
    replace_in(file, "length_mm = 134.112", "length_mm = 140")
    void = page_of(file)
    assert "5 of 6" in void
    assert "(void: tool.length_mm 134.112, now 140)" in void
    assert ">open<" in void
