"""One value of a TOML text changes; comments, layout and all other values stay."""

from __future__ import annotations

import tomllib
from functools import reduce
from operator import getitem
from typing import Any

import pytest

from arm.io.toml_edit import content, place_of

TEXT = """# of the file
a = 1  # of a
"b" = 'x' # b = 2
[t]
a = [1, [2,
  3]] # of the list
c.d = 2026-11-27
e = { a = 5, f = "}" }
# of u
[[u]]
a = true
[[u]]
a = -1e3
g = '''
a = 7
'''
"""


@pytest.mark.parametrize(
    ("steps", "old", "new"),
    [
        (["a"], "a = 1 ", "a = 9 "),
        (["b"], "'x' #", "9 #"),
        (["t", "a"], "[1, [2,\n  3]] #", "9 #"),
        (["t", "c", "d"], "2026-11-27", "9"),
        (["t", "e", "a"], "a = 5", "a = 9"),
        (["t", "e", "f"], '"}"', "9"),
        (["u", 0, "a"], "true", "9"),
        (["u", 1, "a"], "-1e3", "9"),
        (["u", 1, "g"], "'''\na = 7\n'''", "9"),
        (["new"], "# b = 2\n", "# b = 2\nnew = 9\n"),
        (["t", "new"], '"}" }\n', '"}" }\nnew = 9\n'),
        (["u", 0, "new"], "true\n", "true\nnew = 9\n"),
        (["u", 1, "new"], "7\n'''\n", "7\n'''\nnew = 9\n"),
    ],
)
def test_one_value_changes(steps: list[str | int], old: str, new: str) -> None:
    place = place_of(TEXT, steps)
    assert place is not None
    after = place.set(TEXT, 9)
    assert after == TEXT.replace(old, new, 1)
    wanted: Any = tomllib.loads(TEXT)
    reduce(getitem, steps[:-1], wanted)[steps[-1]] = 9
    assert tomllib.loads(after) == wanted


def test_where_no_edit_changes_one_value_alone_nothing_is_told() -> None:
    assert place_of('"\\u0061" = 1\n', ["a"]) is None
    assert place_of("[a]\nb = 1\n", ["a"]) is None
    assert place_of("t = { a = 1 }\n", ["t", "b"]) is None


def test_what_is_no_toml_has_no_content() -> None:
    assert content("a = 1") == {"a": 1}
    assert content("a =") is None
    assert content("a = '\udcff'") is None
