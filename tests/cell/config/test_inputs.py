"""What changed in a file since a plan was made: each key by name, a table that came or went as one, and only a few."""

from __future__ import annotations

import pytest

from cell.config.inputs import changes, shortened

BOARDS = {f"boards[{name}].{key}": value for name in ("a", "b") for key, value in (("x", 1.0), ("y", 2.0))}


def test_a_table_that_came_or_went_is_told_as_one() -> None:
    without = {key: value for key, value in BOARDS.items() if "[b]" not in key}
    assert changes(BOARDS, without) == ["boards[b] is gone"]
    assert changes(without, BOARDS) == ["boards[b] is new"]
    assert changes(BOARDS, {}) == ["boards[a] is gone", "boards[b] is gone"]


def test_a_key_of_a_table_that_stays_is_told_by_itself() -> None:
    less = {key: value for key, value in BOARDS.items() if key != "boards[b].y"}
    assert changes(BOARDS, less) == ["boards[b].y 2, now not given"]
    assert changes(less, BOARDS) == ["boards[b].y is new"]
    assert changes(BOARDS, BOARDS | {"boards[a].x": 7.0}) == ["boards[a].x 1, now 7"]


@pytest.mark.parametrize(
    ("count", "told"),
    [
        (1, "1"),
        (4, "1; 2; 3; 4"),
        (5, "1; 2; 3; 4; and 1 more"),
        (9, "1; 2; 3; 4; and 5 more"),
    ],
)
def test_four_are_told_and_how_many_more_there_are(count: int, told: str) -> None:
    assert shortened([str(k + 1) for k in range(count)]) == told
