"""What a person types: a whole line, of a length that somebody can type."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from cell.session.dialogue import LONGEST, typed


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
