"""A template sets values, and nothing else of the file changes."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from arm.errors import FileInputError
from arm.io.storage import data_file
from cell.study.question.edit import Template

TEXT = """# head
a = 1  # one
b = [
  1, 2,  # two
  3,
]
[t]
a = "x"   # a = 5
c = [[1, 2], [3, 4]]
[[u]]
a = 1
[[u]]
a = 2
"""
FILE = Path("some.toml")


def test_values_are_set_and_the_rest_stays() -> None:
    keys = ["a", "t.a", "u[1].a", "b[1]", "b[2]", "c", "t.c[1][0]", "u[0].new"]
    text = Template(FILE, TEXT, keys).text([7, "y", 8, 9, 10.5, 11, 12, True])
    wanted = {
        "a": 7,
        "b": [1, 9, 10.5],
        "c": 11,
        "t": {"a": "y", "c": [[1, 2], [12, 4]]},
        "u": [{"a": 1, "new": True}, {"a": 8}],
    }
    assert tomllib.loads(text) == wanted
    for comment in ("# head", "# one", "# a = 5"):
        assert comment in text


def test_the_same_values_give_the_same_content() -> None:
    file = data_file("scenes/realistic/cell.toml")
    keys = ["tool.length_mm", "motion.speed", "unit"]
    content = tomllib.loads(file.read_text())
    values = [content["tool"]["length_mm"], content["motion"]["speed"], content["unit"]]
    assert Template(file, file.read_text(), keys).text(values) == file.read_text()


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("u[2].a", "it has 2 of them, counted from 0: the last is [1])"),
        ("v.a", "it has a, b, t, u"),
        ("t", "is a table"),
        ("u", "is a table"),
        ("b[3]", "counted from 0"),
        ("a[0]", "counted from 0"),
        ("t.cc[0]", "did you mean c?"),
        ("t.zz[0]", "it has a, c; write the whole list into it first"),
        ("a b", "is not a key"),
        ("[0]", "is not a key"),
    ],
)
def test_a_key_without_a_value_is_told(key: str, words: str) -> None:
    with pytest.raises(FileInputError) as told:
        Template(FILE, TEXT, [key])
    assert words in str(told.value)


def test_a_pose_by_tape_that_varies_in_a_file_with_another_is_told() -> None:
    text = "[pose]\nT_base_camera = [[1, 0, 0, 0]]\n"
    with pytest.raises(FileInputError) as told:
        Template(FILE, text, ["pose.position_mm[2]"])
    assert (
        "it has T_base_camera; write position_mm, looks_at_mm, right_azimuth_deg instead of it first"
        in str(told.value)
    )


@pytest.mark.parametrize("keys", [["b", "b[1]"], ["b[1]", "b"], ["t.a", "t.a"], ["t.c[1]", "t.c[1][0]"]])
def test_a_value_varies_once(keys: list[str]) -> None:
    with pytest.raises(FileInputError, match="varies twice"):
        Template(FILE, TEXT, keys)


def test_a_list_that_is_set_stays_as_it_was_given() -> None:
    template, given = Template(FILE, TEXT, ["b", "a"]), [5, 6]
    template.text([given, 1])
    assert given == [5, 6]


def test_what_the_file_states_stays_when_values_are_set() -> None:
    template = Template(FILE, TEXT, ["b[1]", "t.c[1][0]"])
    template.text([9, 9])
    assert [template.stated(0), template.stated(1)] == [2, 3]
