"""TOML files: what is not TOML, too deep, too long or too large is refused in one line."""

from pathlib import Path

import pytest

from arm.errors import FileInputError
from arm.io.toml_reader import read_toml


def test_integers_beyond_the_range_of_floats_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    for digits, told in (
        ("9" * 400, r"t\.toml: a = 9"),
        ("9" * 5000, r"t\.toml: has a number that is too long"),
    ):
        path.write_text(f"a = {digits}\nb = [{digits}, 1]\n")
        with pytest.raises(FileInputError, match=told):
            read_toml(path)
    path.write_text(f"b = [{'9' * 400}, 1]\n")
    with pytest.raises(FileInputError, match=r"b\[0\] = 9.*must be a whole number of at most 64 bits"):
        read_toml(path)


def test_invalid_toml_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "t.toml"
    path.write_text("a = 1\nb = = 2\n")
    with pytest.raises(FileInputError, match="line 2"):
        read_toml(path)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            '<?xml version="1.0"?>\n',
            "is XML, such as a URDF (an arm file names a URDF: arm.urdf), and a TOML",
        ),
        ("image_width: 1920\nimage_height: 1200\n", "looks like YAML, and a TOML"),
        ("<!doctype html>\n", "is an HTML page, such as a preview or a report, and a TOML"),
    ],
)
def test_markup_in_place_of_toml_is_told_as_such(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "t.toml").write_text(text)
    with pytest.raises(FileInputError) as refused:
        read_toml(tmp_path / "t.toml")
    assert str(refused.value) == f"{tmp_path / 't.toml'}: {told} file belongs here"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[m]\nspeed = 0.5\n[b]\n", ""),
        (
            "a = 1\n[m]  # of the arm\nspeed = 0.5\nx = [\n 1]\nspeed = 0.2\n[b]\n",
            ": speed = 0.2 (speed is there twice in its table [m], first in line 3; remove one of both)",
        ),
        (
            "a = 1\na = 2\n\n",
            ": a = 2 (a is there twice above the first table, first in line 1; remove one of both)",
        ),
        (
            "[[w]]\na = 1\n[[w]]\na = 1\na = 2",
            "(a is there twice in its table [[w]], first in line 4; remove one of both)",
        ),
        ("a.b = 1\na = 2\nc = 3", ": a = 2"),
        ("a = 1\n[a]\nb = 2\n", ": [a]"),
    ],
)
def test_a_key_that_is_there_twice_is_told_with_its_table(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "t.toml").write_text(text)
    if not told:
        read_toml(tmp_path / "t.toml")
        return
    with pytest.raises(FileInputError) as refused:
        read_toml(tmp_path / "t.toml")
    assert "Cannot overwrite a value" in str(refused.value)
    assert str(refused.value).endswith(told)


@pytest.mark.parametrize(("end", "told"), [("", True), (",", False)])
def test_a_comma_that_is_missing_in_a_list_is_told(tmp_path: Path, end: str, told: bool) -> None:
    (file := tmp_path / "a.toml").write_text(f'files = [\n  "a.csv"{end}  # first\n\n  "b.csv",\n')
    with pytest.raises(FileInputError) as refused:
        read_toml(file)
    assert ("(a comma is missing at the end of line 2)" in str(refused.value)) == told


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
        read_toml(tmp_path / "a.toml")


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
def test_dots_in_strings_and_comments_are_not_key_parts(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    assert "a" in read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize(
    "text", ['"' * 500_000, '"\\"' * 300_000, "a" * 1_000_000, "a." * 500_000, "a. " * 300_000]
)
def test_reading_time_is_linear_in_the_length(tmp_path: Path, text: str) -> None:
    """Seconds would be hours if time grew with the square of the length."""
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(FileInputError):
        read_toml(tmp_path / "a.toml")


def test_an_integer_of_more_than_64_bits_is_refused_by_its_key(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f"a = [{{ b = {2**63 - 1} }}, {{ b = {-(2**63)} }}]")
    read_toml(tmp_path / "a.toml")
    for wrong in (2**63, -(2**63) - 1, 10**400):
        (tmp_path / "a.toml").write_text(f"a = [{{ b = 1 }}, {{ b = {wrong} }}]")
        with pytest.raises(
            FileInputError, match=r"a\[1\]\.b = .*: must be a whole number of at most 64 bits"
        ):
            read_toml(tmp_path / "a.toml")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("unit = crs93", ": unit = crs93 (text stands in quotation marks)"),
        ("length_mm = 36,5", ": length_mm = 36,5 (the decimal sign is a point)"),
        ("length_mm 36", ": length_mm 36"),
        ("length_mm = 36 mm", "(the value is the number alone; its unit is part of the key's name)"),
        ("length_mm: 36", "(a key and its value are separated by one =)"),
        ("length_mm == 36", "(a key and its value are separated by one =)"),
        ("centre_mm = [350 0 -20]", "(numbers of a list are separated by commas)"),
        ("unit = \u201ccrs93\u201d", '(quotation marks are straight: ")'),
        (
            "[walls]\n[walls]",
            "(walls stands above already; tables of which there may be several are written [[walls]])",
        ),
        ("[walls]\n[[walls]]", "(walls stands above already; "),
        (f"a = [{'1 ' * 300}", "characters left out"),
    ],
)
def test_a_line_that_is_no_toml_is_shown_with_what_is_often_wrong(
    tmp_path: Path, line: str, told: str
) -> None:
    file = tmp_path / "a.toml"
    file.write_text(f"first = 1\n{line}\nlast = 3\n")
    with pytest.raises(FileInputError) as refused:
        read_toml(file)
    assert f"{file}: is not valid TOML: " in str(refused.value)
    assert told in str(refused.value)[-120:]
