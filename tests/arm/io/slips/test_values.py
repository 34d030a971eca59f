"""What a wrong value was rather meant to be: told if it is certain enough, else nothing."""

from pathlib import Path
from typing import Any

import pytest

from arm.errors import FileInputError
from arm.io.node import Node
from arm.io.rules import integer, integers, is_whole, number, numbers, rule_of, same, text, triple

UNIT = "a number stands without its unit, which the key names, and without quotation marks"


@pytest.mark.parametrize(
    ("value", "rule", "help"),
    [
        ("134.1", number("mm", 1, 1000), "a number stands without quotation marks"),
        ("134,1", number("mm", 1, 1000), "the decimal sign is a point, and a number stands without quotation marks"),
        ("60 mm", number("mm", 1, 300), UNIT),
        ("10%", number("", 0, 1), UNIT),
        (["1", "2", "3"], numbers(3, "mm"), "a number stands without quotation marks"),
        ("1, 2, 3", numbers(3, "mm"), "a list stands in square brackets, without quotation marks"),
        ([1, 2], numbers(3, "mm"), "it has 2"),
        ([], triple("mm", 1, 500), "it has none"),
        ("5", integer(1, 100), "a number stands without quotation marks"),
        ([1, 2], integers(6, 1, 9), "it has 2"),
    ],
)  # fmt: skip
def test_what_was_meant_is_told(value: Any, rule: Any, help: str) -> None:
    with pytest.raises(FileInputError) as refused:
        Node(Path("a.toml"), "key", value).read(rule)
    assert str(refused.value).endswith(f" ({help})")


@pytest.mark.parametrize(
    ("value", "rule"),
    [
        ("abc", number("mm", 1, 1000)),
        ([[1, 2], [3]], numbers(2, "mm", 1, 2)),
    ],
)
def test_what_is_not_certain_enough_is_not_told(value: Any, rule: Any) -> None:
    with pytest.raises(FileInputError) as refused:
        Node(Path("a.toml"), "key", value).read(rule)
    assert not str(refused.value).endswith(")")


@pytest.mark.parametrize("value", ["CRS93", " crs93", "crs93 "])
def test_a_word_in_other_letters_or_with_spaces_is_recognised(value: str) -> None:
    with pytest.raises(FileInputError, match=r"\(did you mean 'crs93'\?\)$"):
        Node(Path("a.toml"), "unit", value).read(text("crs93", "crs97"))


def test_a_number_in_quotation_marks_is_told_where_words_may_stand_too() -> None:
    rule = rule_of("each, or a whole number from 1", lambda v: v == "each" or is_whole(v, 1), same)
    with pytest.raises(FileInputError, match=r"\(a number stands without quotation marks: 2\)$"):
        Node(Path("a.toml"), "look_after", "2").read(rule)
    for other in ("0", "1.5", "two"):
        with pytest.raises(FileInputError, match=r"must be each, or a whole number from 1$"):
            Node(Path("a.toml"), "look_after", other).read(rule)
