"""What is often wrong in a line that is not TOML: the right cause, or none."""

import tomllib

import pytest

from arm.io.slips.syntax import place_of

ALONE = "the value is the number alone; its unit is part of the key's name"
ESCAPE = "a backslash in quotation marks begins an escape: write / instead, or 'in single ones'"


@pytest.mark.parametrize(
    ("line", "help"),
    [
        ("unit = “crs93”", 'quotation marks are straight: "'),
        ("q = [-60°, -40, 0]", ALONE),
        ("length_mm = 134 mm", ALONE),
        ("speed = 50 %  # slow", ALONE),
        ("q = [\u201360, 0]", "the minus sign is a hyphen (-)"),
        ('camera = "C:\\Users\\me.toml"', ESCAPE),
        ("q = (-60, -40)", "a list stands in square brackets"),
        ("q = -60, -40, 0", "a list stands in square brackets"),
        ("length_mm = 36,5", "the decimal sign is a point"),
        ("[0.026, 0.998, -0.059, 0.492],", "a row of a list whose first line, KEY = [, is missing"),
        ("stamps = True", "true and false are written in small letters"),
        ("background = null", "TOML has no such value: leave the key out"),
        ("stamps = yes", "it is true or false"),
        ("unit =", "the value is missing"),
        ("speed = .5", "a digit stands on both sides of the decimal point"),
        ("speed = 1.", "a digit stands on both sides of the decimal point"),
        ("id = 01", "a number does not begin with a 0"),
        ("from_board = [01, 02]", "a number does not begin with a 0"),
        ("from_board = [1, 02]", "a number does not begin with a 0"),
        ("unit = crs93", "text stands in quotation marks"),
        ("// unit", "a comment begins with #"),
        ("[t]\nx = 1\n[t]", "t stands above already; tables of which there may be several are written [[t]]"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_line_is_told(line: str, help: str) -> None:
    text = f"first = 1\n{line}\nlast = 3\n"
    with pytest.raises(tomllib.TOMLDecodeError) as refused:
        tomllib.loads(text)
    assert place_of(text, str(refused.value)) == f": {line.splitlines()[-1]} ({help})"


@pytest.mark.parametrize("line", ["length_mm 36", "= 3"])
def test_what_is_not_known_is_not_told(line: str) -> None:
    text = f"{line}\n"
    with pytest.raises(tomllib.TOMLDecodeError) as refused:
        tomllib.loads(text)
    assert place_of(text, str(refused.value)) == f": {line}"


def test_a_line_with_a_key_of_its_own_does_not_go_on_the_one_before() -> None:
    text = 'cell = "cell.toml"\nids = [1; 2]\n'
    with pytest.raises(tomllib.TOMLDecodeError) as refused:
        tomllib.loads(text)
    assert "line 1" not in place_of(text, str(refused.value))
