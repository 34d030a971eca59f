"""How commands end: the exit code of a run, and an error in one line. As `cell.cli.main` it imports nothing heavy."""

from __future__ import annotations

import json
import re
import sys
from contextlib import suppress
from itertools import pairwise
from typing import Any, NoReturn

import typer

from arm.errors import A465Error, ExecutionStopped, InputError
from cell.cli.options import refuse
from cell.console import Console, OutputLost, say_on_stderr


def finish(console: Console, report: dict[str, Any]) -> None:
    """Print the report of a run; exit with a code other than 0 if a cube was not placed."""
    console.result(report)
    left = [cube["from"] for cube in report["cubes"] if not cube["placed"]]
    if left:
        why = f"not finished: cubes not placed: {', '.join(left)}; the arm is at q_start"
        refuse(why, ExecutionStopped.exit_code)


def fail(error: A465Error) -> NoReturn:
    """Print the error in one line, with ``--json`` also as an object, and exit with the code of its kind."""
    if "--json" in sys.argv and not isinstance(error, OutputLost):
        kind, code = type(error).__name__, error.exit_code
        body = {"error": {"kind": kind, "message": str(error), "exit_code": code, **error.data}}
        with suppress(OutputLost):  # standard error and the exit code report it too
            Console().say(json.dumps(body, indent=2, default=str))
    say_on_stderr(f"a465: {error.word}: {error}{_json_help(error)}")
    sys.exit(error.exit_code)


def _json_help(error: A465Error) -> str:
    """Say that ``--json`` takes no file if the error is of the word after it; "" if it is not."""
    for option, word in pairwise(sys.argv):
        if option == "--json" and word == str(error.data.get("file")):
            return "; --json takes no file: its object goes to standard output"
    return ""


def fail_usage(error: typer.TyperException, app: typer.Typer) -> NoReturn:
    """Print what is wrong with a command's name, options or arguments, in one line, and exit as `fail` does.

    A group without a command prints its help instead. `app` has all commands with their parameters.
    """
    from cell.cli.usage import usage_help  # 7 ms, of which help has no need

    words, context = error.format_message(), getattr(error, "ctx", None)
    if context is not None and words == context.get_help():
        say_on_stderr(words)
        sys.exit(InputError.exit_code)
    verbs = _typed() if context is None else _verbs(context)
    help = usage_help(words, sys.argv[1:], verbs, _commands(app))
    why = " ".join(words.split()).removesuffix(".").replace("is not a valid float", "is not a number")
    why = why.removesuffix(". Did you mean 'release'?")  # nobody is led to where the arm may drop
    if help:  # better than the parser's guess
        why = f"{re.sub(r' [(]Possible options: .*[)]$', '', why)} ({help})"
    why = f"{why}; see {' '.join(('a465', *verbs))} --help"
    fail(InputError(f"{' '.join(verbs)}: {why}" if verbs else why, command=verbs))


def _commands(app: typer.Typer) -> dict[str, Any]:
    """Return all commands by their words: one, or two of a group."""
    every: dict[str, Any] = {}
    for name, one in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        every |= {f"{name} {inner}": command for inner, command in getattr(one, "commands", {}).items()} or {
            name: one
        }
    return every


def _verbs(context: Any) -> list[str]:
    """Return the command of a context: a word, or two if it is one of a group."""
    above = context.parent
    return [] if above is None else [*_verbs(above), str(context.info_name)]


def _typed() -> list[str]:
    """Return the command that was typed."""
    return sys.argv[1 : 3 if sys.argv[1:2] == ["calibrate"] else 2]
