"""Every message of the TOML reader holds file, key, value and rule."""

from pathlib import Path

import pytest

from arm.errors import FileInputError
from arm.toml_table import TomlTable

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
    with pytest.raises(FileInputError, match=r"must be 2 numbers"):
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
