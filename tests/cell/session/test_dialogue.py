"""What a person types: a whole line, of a length that somebody can type."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from arm.errors import InputError
from cell.session.dialogue import LONGEST, answered, typed
from typed.heard import Heard


@pytest.fixture
def keys(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Gives what is read, one piece after the other."""
    read, write = os.pipe()
    pieces: list[bytes] = []
    os.write(write, b"ready")
    with open(read) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr("cell.session.dialogue.os.read", lambda *_: pieces.pop(0) if pieces else b"")
        yield pieces
    os.close(write)


@pytest.mark.parametrize(("size", "whole"), [(1, True), (LONGEST, True), (20_001, False), (60_000, False)])
def test_a_line_of_any_length_that_a_terminal_gives_is_one_and_a_stream_is_none(
    keys: list[bytes], size: int, whole: bool
) -> None:
    assert LONGEST == 20_000
    keys += [b"x" * size, b"\n"]
    assert typed() == ("x" * size if whole else None)


def test_what_ends_without_an_end_of_line_is_no_answer(keys: list[bytes]) -> None:
    keys += [b"crs", b"93"]
    assert typed() is None
    keys += [b"crs", b"93 \n"]
    assert typed() == "crs93"


def test_an_answer_is_asked_for_until_it_is_right_and_enter_is_none() -> None:
    heard = Heard()

    def number(line: str) -> int:
        if not line.isdigit():
            raise InputError(f"{line}: must be digits")
        return int(line)

    def answer(*lines: str | None) -> int | None:
        rest = iter(lines)
        return answered(heard, "how many?", number, lambda: next(rest), "give --count")

    assert answer("a", "b", " 3 ") == 3
    assert heard.told == [
        "how many?",
        "a: must be digits; 2 more tries",
        "how many?",
        "b: must be digits; 1 more try",
    ] + ["how many?"]
    assert answer("") is None
    assert answer("x", " ") is None
    with pytest.raises(InputError, match="c: must be digits"):
        answer("a", "b", "c")
    with pytest.raises(InputError, match=r"nobody answered: how many\?; give --count"):
        answer(None)
