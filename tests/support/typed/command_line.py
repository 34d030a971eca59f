"""The command line as a user has it: its exit code, what it says, and files that the user changed."""

from __future__ import annotations

import io
import subprocess
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from unittest.mock import patch

import typer.main

from cell.cli.main import main

_command_of = cache(typer.main.get_command)  # which typer makes anew for each call of an app, in 0.1 s


def replace_in(path: Path, old: str, new: str) -> None:
    """Replaces the first `old` in a file, which has to be there."""
    text = path.read_text()
    assert old in text, old
    path.write_text(text.replace(old, new, 1))


def _in_a_process(arguments: list[str], flags: list[str], cwd: Path) -> tuple[int, str, str]:
    command = [sys.executable, *flags, "-c", "import cell.cli.main; cell.cli.main.main()", *arguments]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, timeout=600)
    assert "Traceback" not in ran.stderr, ran.stderr[-4000:]
    return ran.returncode, ran.stdout, ran.stderr


def _here(arguments: list[str], cwd: Path) -> tuple[int, str, str]:
    """What `main` does in this process, which has everything imported; an error that it lets out is the test's."""
    said, told, code = io.StringIO(), io.StringIO(), 0
    with (
        chdir(cwd),
        redirect_stdout(said),
        redirect_stderr(told),
        patch.object(sys, "argv", ["a465", *arguments]),
        patch("typer.main.get_command", _command_of),
    ):
        try:
            main()
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, said.getvalue(), told.getvalue()


def a465(
    *arguments: object,
    optimised: bool = False,
    own_process: bool = False,
    code: int = 0,
    cwd: Path | None = None,
) -> tuple[str, str]:
    """What a command says on its standard output and error; it has to end with `code` and without a traceback.

    It runs in this process, unless it shall have one of its own or be optimised.
    """
    words, folder = [str(argument) for argument in arguments], cwd or Path.cwd()
    if optimised or own_process:
        ended, said, told = _in_a_process(words, ["-O"] if optimised else [], folder)
    else:
        ended, said, told = _here(words, folder)
    assert ended == code, f"exit {ended}: {said[-2000:]}{told[-4000:]}"
    return said, told


def ended(*arguments: object, cwd: Path) -> tuple[int, str]:
    """Exit code of a command in this process, whichever it is, and what it says on its standard error."""
    code, _, told = _here([str(argument) for argument in arguments], cwd)
    return code, told


def refused(*arguments: object, code: int, cwd: Path) -> str:
    """The one line of a refusal, which optimised Python in a process of its own tells as well."""
    for optimised in (False, True):
        _, told = a465(*arguments, code=code, cwd=cwd, optimised=optimised)
        lines = [line for line in told.splitlines() if line.startswith("a465:")]
        assert len(lines) == 1, told
    return lines[0]


def value_of(words: list[str], option: str) -> str | None:
    """What follows an option, or None."""
    place = words.index(option) + 1 if option in words else len(words)
    return words[place] if place < len(words) else None


def set_value(words: list[str], option: str, value: str) -> None:
    """Replaces what follows an option."""
    words[words.index(option) + 1] = value
