"""Every message of the TOML reader holds file, key, value and rule."""

from pathlib import Path

import numpy as np
import pytest

from arm.errors import FileInputError
from arm.io.toml_reader import TomlTable

TEXT = """
length_mm = 134.1
count = 3
name = "crs93"
on = true
triple = [1, 2, 3]
rows = [[1, 2], [3, 4]]
[sub]
x = 1
[[list]]
y = 2
"""


@pytest.fixture
def table(tmp_path: Path) -> TomlTable:
    path = tmp_path / "t.toml"
    path.write_text(TEXT)
    return TomlTable.read(path)


def test_good_values(table: TomlTable) -> None:
    assert table.number("length_mm", "mm", 0, 500) == 134.1
    assert table.integer("count", 0, 5) == 3
    assert table.text("name", choices=("crs93", "crs97")) == "crs93"
    assert table.flag("on") is True
    assert table.numbers("triple", 3, "mm").tolist() == [1, 2, 3]
    assert table.matrix("rows", 2, 2).tolist() == [[1, 2], [3, 4]]
    assert table.table("sub").integer("x", 0, 1) == 1
    assert [t.integer("y", 0, 9) for t in table.tables("list")] == [2]
    assert table.number("absent", "mm", default=7) == 7
    table.finish()


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (
            lambda t: t.number("length_mm", "mm", 200, 500),
            r"length_mm = 134.1: must be a number in mm from 200 to 500",
        ),
        (lambda t: t.number("name", "mm"), "must be a number in mm"),
        (lambda t: t.number("on", "mm"), "must be a number in mm"),
        (lambda t: t.number("lenght_mm", "mm"), r"lenght_mm: is missing; .*the file has length_mm"),
        (lambda t: t.integer("length_mm", 0, 500), "whole number"),
        (lambda t: t.text("name", choices=("crs97", "crs94")), "did you mean"),
        (lambda t: t.numbers("triple", 6, "deg"), "must be 6 numbers in deg"),
        (lambda t: t.numbers("name", 5, "deg"), "must be 5 numbers"),
        (lambda t: t.matrix("rows", 4, 4), "4 rows of 4 numbers"),
        (lambda t: t.table("count"), "must be a table"),
        (lambda t: t.table("sub").text("x"), r"sub\.x = 1: must be a text"),
        (lambda t: t.tables("list")[0].text("y"), r"list\[0\]\.y = 2"),
        (lambda t: t.path("name"), "not there"),
        (lambda t: t.finish(), "is not a known key"),
    ],
)
def test_bad_values_are_told(table: TomlTable, read, message: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(FileInputError, match=message) as error:
        read(table)
    assert "t.toml" in str(error.value)
    assert {"file", "key", "value", "rule"} <= set(error.value.data)


def test_numbers_that_no_float_holds_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    for digits, told in (
        ("9" * 400, r"t\.toml: a = 9"),
        ("9" * 5000, r"t\.toml: has a number that is too long"),
    ):
        path.write_text(f"a = {digits}\nb = [{digits}, 1]\n")
        with pytest.raises(FileInputError, match=told):
            TomlTable.read(path).number("a", "mm")
    path.write_text(f"b = [{'9' * 400}, 1]\n")
    with pytest.raises(FileInputError, match=r"b\[0\] = 9.*must be a whole number of 64 bits"):
        TomlTable.read(path).numbers("b", 2, "mm")


def test_a_misspelt_key_gets_the_nearest_known_one(table: TomlTable) -> None:
    for key in ("length_mm", "names", "on", "triple", "rows", "sub", "list", "count"):
        assert key in table or key == "names"
    with pytest.raises(FileInputError, match=r"name = 'crs93': is not a known key .*did you mean names"):
        table.finish()


def test_what_is_not_toml_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_text("a = 1\nb = = 2\n")
    with pytest.raises(FileInputError, match="line 2"):
        TomlTable.read(path)


def _dotted(parts: int) -> str:
    return ".".join(["a"] * parts)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (f"{_dotted(100_000)} = 1", 1),
        (f"[{_dotted(17)}]", 1),
        (f"x = 1\n# a\n[[{_dotted(17)}]]", 3),
        ("x = { " + " . ".join(['"a b.c"', "'d'", "e-f_1"] * 6) + " = 1 }", 1),
        ("\n" * 20 + _dotted(17), 21),
    ],
)
def test_a_key_of_many_parts_is_refused_before_it_fills_the_memory(
    tmp_path: Path, text: str, line: int
) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(FileInputError, match=rf"a\.toml: line {line}: has a key of more than 16 parts"):
        TomlTable.read(tmp_path / "a.toml")


@pytest.mark.parametrize(
    "text",
    [
        f"{_dotted(16)} = 1",
        f'a = "{_dotted(100)}"',
        f"a = '{_dotted(100)}'",
        f"a = 1 # {_dotted(100)}",
        f'a = "\\"{_dotted(100)}"',
        "a = [" + "1.5, " * 1000 + "]",
    ],
)
def test_dots_elsewhere_are_no_key(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    assert "a" in TomlTable.read(tmp_path / "a.toml")


@pytest.mark.parametrize(
    "text", ['"' * 500_000, '"\\"' * 300_000, "a" * 1_000_000, "a." * 500_000, "a. " * 300_000]
)
def test_no_text_takes_long_to_look_through(tmp_path: Path, text: str) -> None:
    """Seconds would be hours if time grew with the square of the length."""
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(FileInputError):
        TomlTable.read(tmp_path / "a.toml")


def test_an_integer_of_more_than_64_bits_is_refused_by_its_key(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f"a = [{{ b = {2**63 - 1} }}, {{ b = {-(2**63)} }}]")
    TomlTable.read(tmp_path / "a.toml")
    for wrong in (2**63, -(2**63) - 1, 10**400):
        (tmp_path / "a.toml").write_text(f"a = [{{ b = 1 }}, {{ b = {wrong} }}]")
        with pytest.raises(FileInputError, match=r"a\[1\]\.b = .*: must be a whole number of 64 bits"):
            TomlTable.read(tmp_path / "a.toml")


def test_a_matrix_of_giant_numbers_is_refused_in_one_line(tmp_path: Path) -> None:
    rows = np.diag([1e200, 1.0, 1.0, 1.0]).tolist()
    (tmp_path / "a.toml").write_text(f"T = {rows}")
    with pytest.raises(FileInputError, match=r"T = .*: must be numbers from -1e\+09 to 1e\+09"):
        TomlTable.read(tmp_path / "a.toml").rigid("T")
