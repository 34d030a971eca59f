"""Rows of docs/formats.md are those of the declared keys, and every page is in the contents."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from cell.texts.key_texts import FILES, declared_keys, rows_of, texts_of
from typed.doc_pages import ROOT, pages

DOCS = ROOT / "docs"


def test_the_page_has_the_rows_of_the_declared_keys() -> None:
    with_rows = runpy.run_path(str(DOCS / "key_rows.py"))["with_rows"]
    page = (DOCS / "formats.md").read_text()
    assert with_rows(page) == page, "python docs/key_rows.py writes the rows anew"


@pytest.mark.parametrize("file", FILES)
def test_every_key_has_a_text_and_a_row_and_every_text_a_key(file: str) -> None:
    declared = declared_keys(*FILES[file])
    tables = {name.rpartition(".")[0].replace("[]", "") for name in declared}
    texts = (
        set(texts_of(file)) - tables - {"", "calibration.id"}
    )  # a placeholder's source, in a table without rules
    assert texts == {name.replace("[]", "") for name in declared} - {"views"}
    assert set(rows_of(file)) == set(declared) - {"views"}
    assert len(rows_of(file)) >= 2
    section = (
        (DOCS / "formats.md")
        .read_text()
        .partition(f"\n## {file.capitalize()} file\n")[2]
        .partition("\n## ")[0]
    )
    assert [row for row in rows_of(file).values() if row not in section] == []


def test_every_page_is_in_the_contents_once() -> None:
    index = (ROOT / "docs/index.md").read_text()
    trees = re.findall(r"```\{toctree\}\n(.*?)```", index, re.S)
    listed = [line for tree in trees for line in tree.splitlines() if line and not line.startswith(":")]
    written = [page.relative_to(ROOT / "docs").with_suffix("").as_posix() for page in pages()[1:]]
    rooms = [f"api/{room}" for room in ("a465", "arm", "plan", "vision", "driver", "render", "calib", "cell")]
    assert sorted([*listed, "index"]) == sorted([*written, *rooms])


def test_every_link_between_pages_leads_somewhere() -> None:
    for page in pages():
        text = re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.M | re.S)
        for target, anchor in re.findall(r"\]\(([^)#:\s]*)(?:#([^)\s]+))?\)", text):
            file = (page.parent / target) if target else page
            assert file.is_file(), f"{page.name}: {target}"
            assert not anchor or anchor in anchors(file), f"{page.name}: {target}#{anchor}"


def anchors(page: Path) -> set[str]:
    """Of the headings of a page, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.*)$", page.read_text(), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
