"""The list of commands is grouped, and has each command once."""

from __future__ import annotations

import re

import typer.main

from cell.cli.groups import GROUPS, GroupedCommands
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
