"""Messages are one line that can be read, whatever a file or a name put into them."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.errors import MOST_MESSAGE, A465Error, FileInputError, shortened


def test_a_message_has_at_most_500_characters_and_says_what_is_left_out() -> None:
    error = A465Error("begin " + "x" * 3000 + " end")
    assert 495 <= len(str(error)) <= 500
    assert str(error).startswith("begin xxx")
    assert str(error).endswith("xxx end")
    assert f".. {3000 - str(error).count('x')} characters left out .." in str(error)


def test_a_message_that_fits_is_as_it_is() -> None:
    assert str(A465Error("x" * MOST_MESSAGE)) == "x" * MOST_MESSAGE


@pytest.mark.parametrize("length", [501, 520, 999, 1000, 1008, 1009, 9_999, 10_490, 10_500, 123_456])
def test_the_count_of_omitted_characters_is_exact(length: int) -> None:
    text = shortened("x" * length)
    assert len(text) <= 500
    assert f" .. {length - text.count('x')} characters left out .. " in text


def test_a_long_value_leaves_room_for_rule_and_help() -> None:
    error = FileInputError(
        Path("cell.toml"), "look.photographs", ["word"] * 10_000, "must be a number", "give 3"
    )
    told = str(error)
    assert len(told) <= 500
    assert told.startswith("cell.toml: look.photographs = ['word', 'word'")
    assert "characters left out" in told
    assert told.endswith(": must be a number (give 3)")
    assert error.data["value"] == ["word"] * 10_000
