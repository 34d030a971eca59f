"""Bytes of a terminal as keys: arrows are whole sequences, and whatever else begins with escape stops."""

from __future__ import annotations

import pytest

from cell.commands.jog.keys import JOINTS, TOOL, Press, presses

UP, DOWN, STOP = Press("move", 1), Press("move", -1), Press("stop")


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"\x1b[A", [UP]),
        (b"\x1bOB", [DOWN]),
        (b"\x1b[A\x1b[A\x1b[B", [UP, UP, DOWN]),
        (b"+-=", [UP, DOWN, UP]),
        (b"\x1b", [STOP]),
        (b" ", [STOP]),
        (b"\x1b[A\x1b", [UP, STOP]),
        (b"\x1b[", [STOP]),  # an arrow that came in two parts
        (b"\x1b[C+", [STOP]),  # another key of that kind, and what is behind it does not move the arm
        (b"", [STOP]),  # the terminal is gone
        (b"Z", [Press("choose", axis="z")]),
        (b"a", [Press("choose", axis="along")]),
        (b",>", [Press("scale", -1), Press("scale", 1)]),
        (b"q", [Press("end")]),
        (b"\x04", [Press("end")]),
        (b"m7\r\n\xff", []),
    ],
)
def test_keys(data: bytes, keys: list[Press]) -> None:
    assert presses(data) == keys


def test_every_axis_has_a_key() -> None:
    chosen = [press.axis for press in presses(b"123456xyza")]
    assert chosen == [*JOINTS, *TOOL]
