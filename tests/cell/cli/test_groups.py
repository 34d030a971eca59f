"""The list of commands is grouped, and has each command once."""

from __future__ import annotations

import re

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
