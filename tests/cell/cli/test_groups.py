"""The list of commands is grouped, and has each command once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import typer.main

from cell.cli.groups import COMPLETING, GROUPS, GroupedCommands, built_for
from cell.cli.main import app
from typed.command_line import a465


def test_every_command_is_in_one_group() -> None:
    grouped = [name for names in GROUPS.values() for name in names]
    command = typer.main.get_command(app)
    assert isinstance(command, GroupedCommands)
    assert sorted(grouped) == sorted(command.commands)


def test_the_help_lists_them_under_their_headings() -> None:
    said, _ = a465("--help")
    found: dict[str, list[str]] = {}
    for line in said[said.index("Set up:") :].splitlines():
        if heading := re.fullmatch(r"(\w[\w ]*):", line):
            found[heading[1]] = []
        elif row := re.match(r"  ([a-z-]+) ", line):
            found[list(found)[-1]].append(row[1])
    assert {heading: tuple(names) for heading, names in found.items()} == GROUPS


def test_a_command_of_no_group_is_not_lost() -> None:
    other = typer.Typer(cls=GroupedCommands, rich_markup_mode=None)
    for name in (*(n for names in GROUPS.values() for n in names), "new-one"):
        other.command(name, short_help="Do it.")(lambda: None)
    command = typer.main.get_command(other)
    context = command.make_context("a465", [], resilient_parsing=True)
    told = command.get_help(context)
    assert re.search(r"^  new-one +Do it\.$", told, re.MULTILINE)


@pytest.mark.parametrize("verb", ["", "plan", "calibrate"])
def test_only_the_command_that_is_asked_gets_its_parameters(verb: str) -> None:
    every = typer.main.get_command(app)
    light = typer.main.get_command(built_for(app, ["--quick", *verb.split(), "--help"]))
    assert isinstance(every, GroupedCommands)
    assert isinstance(light, GroupedCommands)
    assert list(light.commands) == list(every.commands)
    for name, command in light.commands.items():
        whole = every.commands[name]
        assert command.get_short_help_str(200) == whole.get_short_help_str(200)
        names = [parameter.name for parameter in whole.params] if name == verb else []
        assert [parameter.name for parameter in command.params] == names
        assert list(getattr(command, "commands", ())) == (
            list(getattr(whole, "commands", ())) if name == verb else []
        )


def test_a_shell_that_completes_words_has_all_parameters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(COMPLETING, "complete_bash")
    assert built_for(app, []) is app


@pytest.mark.parametrize(
    ("typed", "option"),
    [
        ("run task.toml --speed 0.05 --speed 1", "--speed"),
        ("run task.toml --speed=0.5 --world w.toml --speed=0.5", "--speed"),
        ("new-cell mine --unit crs93 --unit crs97", "--unit"),
        ("plan cell.toml -o a.json --output b.json", "--output"),
        ("runs --prune 30 there --prune 1", "--prune"),
        ("check plan.json --q 0,0,0,0,0,0 --q=1,1,1,1,1,1 --json", "--q"),
        ("home cell.toml --speed 0.1 --speed 0.2", "--speed"),
        ("calibrate hand-eye r.json --cell a.toml --cell b.toml", "--cell"),
        ("calibrate camera views --work-mm 800 900 --work-mm 700 1200", "--work-mm"),
    ],
)
def test_an_option_with_a_value_is_given_once(tmp_path: Path, typed: str, option: str) -> None:
    said, told = a465(*typed.split(), code=2, cwd=tmp_path)
    assert told == f"a465: wrong input: {option}: is given twice\n"
    assert not list(tmp_path.iterdir())
    assert ("--json" in typed) == ('"kind": "InputError"' in said)


@pytest.mark.parametrize(
    "typed",
    [
        "check none.json --json --json",
        "calibrate camera none --fix-zero k3 --fix-zero p1",
        "calibrate camera none --lift a=1 --lift b=2",
        "plan none.toml --advice --no-advice",
        "plan none.toml -- --speed",
    ],
)
def test_lists_and_flags_are_given_as_often_as_one_likes(tmp_path: Path, typed: str) -> None:
    assert "given twice" not in a465(*typed.split(), code=2, cwd=tmp_path)[1]


def test_help_is_printed_whatever_is_given_twice() -> None:
    assert "Usage: " in a465("run", "--speed", 1, "--speed", 0.5, "--help")[0]


@pytest.mark.parametrize(
    ("typed", "option", "after"),
    [
        ("execute plan.json task.toml --port --images shots", "--port", "--images"),
        ("plan task.toml -o --json", "-o", "--json"),
        ("status --cell --json", "--cell", "--json"),
        ("run task.toml --speed --world=w.toml", "--speed", "--world=w.toml"),
    ],
)
def test_an_option_without_its_value_takes_no_other_for_it(
    tmp_path: Path, typed: str, option: str, after: str
) -> None:
    _, told = a465(*typed.split(), code=2, cwd=tmp_path)
    why = f"{option} has no value: {after} after it is an option; is a variable of the shell not set?"
    assert told == f"a465: wrong input: {why}\n"
