"""Values of JSON files: what is not of its type or range is named by its key."""

from __future__ import annotations

from pathlib import Path

import pytest
from arm.io.json_fields import JsonFields

from arm.errors import FileInputError

FIELDS = JsonFields(Path("f.json"))


@pytest.mark.parametrize(
    ("value", "rule"),
    [
        (None, "must be a number from 0 to 2"),
        ("1", "must be a number"),
        (True, "must be a number"),
        (2.1, "0 to 2"),
    ],
)
def test_a_number_is_one_within_its_range(value: object, rule: str) -> None:
    with pytest.raises(FileInputError, match=rule) as refused:
        FIELDS.number({"x": value}, "x", "a.", 0.0, 2.0)
    assert refused.value.data["key"] == "a.x"
    assert FIELDS.number({"x": 2}, "x", "a.", 0.0, 2.0) == 2.0


@pytest.mark.parametrize("value", [[1, 2, 3], [1.0] * 6, [True] * 6, [2**31] + [0] * 5, "123456", None])
def test_counts_are_whole_numbers_of_32_bits(value: object) -> None:
    with pytest.raises(FileInputError, match=r"whole numbers|32-bit"):
        FIELDS.integers(value, "counts")
    assert FIELDS.integers([1 - 2**31, 0, 0, 0, 0, 2**31 - 1], "counts")[5] == 2**31 - 1
    assert FIELDS.integers([7], "counts", None) == (7,)


def test_what_is_missing_no_table_or_no_choice_is_named() -> None:
    with pytest.raises(FileInputError, match=r"a\.x.* is missing; must be one of b, c"):
        FIELDS.choice({}, "x", "a.", ("b", "c"))
    with pytest.raises(FileInputError, match="must be one of b, c"):
        FIELDS.choice({"x": "d"}, "x", "a.", ("b", "c"))
    with pytest.raises(FileInputError, match="must be a table"):
        FIELDS.choice([], "x", "a.", ("b", "c"))
    assert FIELDS.choice({"x": "c"}, "x", "a.", ("b", "c")) == "c"
