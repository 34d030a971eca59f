"""Measured figures on the pages stand in the dated results that they are taken from."""

from __future__ import annotations

import re

import pytest

from typed.doc_pages import ROOT, pages

# Before a block (up to the next empty line): <!-- figures: FILE [FILE ..][; computed: NUMBER ..] -->
MARK = re.compile(r"^<!-- figures: ([^;>]+?)(?:; computed: ([^>]+?))? -->\n+(.*?)(?=\n\s*\n|\Z)", re.M | re.S)
NUMBER = re.compile(r"(?<![\w.])\d{1,3}(?: \d{3})+(?![\d.])|(?<![\w.])\d+(?:\.\d+)?(?:e[-+]?\d+)?")
PLAN_ID = re.compile(r"\b(?=[0-9a-f]*\d)(?=[0-9a-f]*[a-f])[0-9a-f]{12}\b")
BLOCKS = [
    (page.name, files.split(), (computed or "").split(), block)
    for page in pages()
    for files, computed, block in MARK.findall(page.read_text())
]


def numbers(text: str) -> list[str]:
    """Each number as it is written; names in code and links are not figures."""
    plain = re.sub(
        r"`[^`\n]+`|\]\([^)]*\)|\d{4}-\d{2}-\d{2}|\d+ (?:January|November|December) \d{4}", " ", text
    )
    return [number.replace(" ", "") for number in NUMBER.findall(plain)]


def stands(figure: str, measured: list[float]) -> bool:
    """Whether a measured value rounds to the figure, as it is or as the per cent by which a ratio exceeds 1."""
    digits = len(figure.partition(".")[2])
    half = 0.5001 * 10.0**-digits
    return any(
        min(abs(value - float(figure)), abs(100.0 * (value - 1.0) - float(figure))) <= half
        for value in measured
    )


@pytest.mark.parametrize(
    ("page", "files", "computed", "block"), BLOCKS, ids=[f"{b[0]}:{b[3][:40]}" for b in BLOCKS]
)
def test_each_figure_stands_in_the_results(
    page: str, files: list[str], computed: list[str], block: str
) -> None:
    measured = [
        float(number)
        for file in files
        for number in numbers((ROOT / "bench/results" / file).read_text().replace("|", " | "))
    ]
    wrong = [figure for figure in numbers(block) if figure not in computed and not stands(figure, measured)]
    assert not wrong, f"{page}: {wrong} stand in none of {files}"


def test_the_pages_with_figures_of_results_are_marked() -> None:
    """A page that names a dated result has a block that is compared with it."""
    named = {page.name for page in pages() if re.search(r"bench/results/[\w-]+-\d{4}", page.read_text())}
    assert named <= {page for page, *_ in BLOCKS}
    assert len(BLOCKS) >= 8


def test_a_figure_stands_as_it_is_rounded_or_in_per_cent() -> None:
    assert stands("0.32", [0.321])
    assert stands("3.7", [1.037])
    assert not stands("0.33", [0.321])
    assert numbers("10 000 of 9066 in `x-3` (12 %), 1.34e+03") == ["10000", "9066", "12", "1.34e+03"]


def test_no_page_shows_the_id_of_a_plan() -> None:
    """It changes with every version, and what a page shows of a command's output is compared without its figures."""
    shown = {page.name: PLAN_ID.findall(page.read_text()) for page in pages()}
    assert not {name: ids for name, ids in shown.items() if ids}
