"""Rows of numbers in a text: what is a header, and what a wrong cell is."""

from __future__ import annotations

import pytest

from arm.number_rows import has_decimal_commas, has_empty_cell, help_of, is_header, unit_of


@pytest.mark.parametrize(
    ("name", "unit"),
    [("J1_deg", "deg"), ("J1 (rad)", "rad"), ("J1[deg]", "deg"), ("x / mm", "mm"), ("J1 (\u00b0)", "deg"), ("x_m", "m"),
     ("J1", ""), ("team", ""), ("J1_counts", "")],
)  # fmt: skip
def test_the_unit_of_a_column_is_what_its_name_ends_with(name: str, unit: str) -> None:
    assert unit_of(name) == unit


def test_names_are_a_header_and_numbers_with_a_unit_are_none() -> None:
    assert is_header(["J1", "J2"])
    assert not is_header(["0deg", "-10deg"])
    assert not is_header(["home", "0"])
    assert not is_header(["\u221210", "a"])


def test_what_stands_for_a_number_is_told() -> None:
    assert help_of("\u221210", 5) == "its minus is a dash; write -"
    assert help_of("-10.5deg", 5) == "write the number alone: -10.5"
    for date in ("10.Jan", "3/4", "2026-01-10", "1.2.26"):
        assert help_of(date, 5) == "did a spreadsheet make a date of it?"
    assert help_of("1.5x", 5) == ""
    assert help_of("home", 6) == "rows have numbers only; names stand in a list in JSON"
    assert help_of("home", 5) == ""


def test_empty_cells_and_decimal_commas_are_seen() -> None:
    assert has_empty_cell("1,,2")
    assert has_empty_cell(",1,2")
    assert not has_empty_cell("1, 2,")
    assert has_decimal_commas("0,5;1")
    assert not has_decimal_commas("0.5,1")
