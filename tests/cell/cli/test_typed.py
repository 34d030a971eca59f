"""Words that a shell or a word processor has changed are told before anything is read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from arm.errors import InputError
from cell.cli.typed import refuse_mistyped
from typed.command_line import a465


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("\N{EN DASH}q=0,10", "\N{EN DASH}q=0,10: has an en dash where the keyboard's - belongs"),
        ("\N{EM DASH}speed", "has an em dash"),
        ("--q=\N{MINUS SIGN}60,-40", "has a minus sign of mathematics"),
        ("--q=-60,\N{MINUS SIGN}40", "has a minus sign of mathematics"),
        ("“my", "has a typographic quotation mark"),
        ("--name=“tray”", "has a typographic quotation mark"),
        ("--name=", "--name is empty; is a variable of the shell not set?"),
    ],
)
def test_what_a_word_processor_makes_is_told(word: str, told: str) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        refuse_mistyped(["check", "cell.toml", word])


def test_a_path_that_the_shell_split_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("my cell.toml", "b c.toml", "b"):
        Path(name).touch()
    with pytest.raises(InputError, match=r"a path with a space needs quotes: 'my cell\.toml'$"):
        refuse_mistyped(["check", "my", "cell.toml"])
    Path("my own cell.toml").touch()
    with pytest.raises(InputError, match=r"needs quotes: .my own cell"):
        refuse_mistyped(["check", "my", "own", "cell.toml"])
    refuse_mistyped(["check", "b", "c.toml"])


def test_names_of_files_and_words_within_may_have_any_sign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("\N{EN DASH}cell.toml").touch()
    refuse_mistyped(
        [
            "check",
            "\N{EN DASH}cell.toml",
            "--look=\N{EN DASH}cell.toml",
            "--name=tray \N{EN DASH} left",
            "--q=-60,-40",
        ]
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("help plan", "help is an option: a465 plan --help"),
        ("help", "help is an option: a465 --help"),
        ("plan -h", "it is a465 plan --help"),
        ("-h", "it is a465 --help"),
        ("check “cell.toml”", "type ' or \""),
    ],
)
def test_help_by_other_words_is_told(words: str, told: str) -> None:
    _, said = a465(*words.split(), code=2)
    assert told in said
