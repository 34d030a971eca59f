"""How commands end: the exit code of a run, and an error in one line. As `cell.cli.main` it imports nothing heavy."""

from __future__ import annotations

import json
import re
import sys
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
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
    say_on_stderr(f"a465: {error.word}: {error}")
    sys.exit(error.exit_code)


def fail_usage(error: typer.TyperException) -> NoReturn:
    """Print what is wrong with a command's name, options or arguments, in one line, and exit as `fail` does.

    A group without a command prints its help instead.
    """
    words, context = error.format_message(), getattr(error, "ctx", None)
    if context is not None and words == context.get_help():
        say_on_stderr(words)
        sys.exit(InputError.exit_code)
    verbs = _typed() if context is None else _verbs(context)
    is_number = re.search(r"No such option: -[\d.]", words)
    help = " (the values of a list are joined by commas: --q=0,10,-80,0,-60,0)" if is_number else ""
    if "unexpected extra argument" in words:
        help = _spaced() or help
    why = f"{' '.join(words.split()).removesuffix('.')}{help}; see {' '.join(('a465', *verbs))} --help"
    fail(InputError(f"{' '.join(verbs)}: {why}" if verbs else why, command=verbs))


def _spaced() -> str:
    """Name a path with a space of which the shell made two arguments; "" if there is none."""
    for first, second in pairwise(sys.argv[1:]):
        if not second.startswith("-") and not Path(first).is_file() and Path(f"{first} {second}").exists():
            return f" (a path with a space needs quotes: '{first} {second}')"
    return ""


def _verbs(context: Any) -> list[str]:
    """Return the command of a context: a word, or two if it is one of a group."""
    above = context.parent
    return [] if above is None else [*_verbs(above), str(context.info_name)]


def _typed() -> list[str]:
    """Return the command that was typed."""
    return sys.argv[1 : 3 if sys.argv[1:2] == ["calibrate"] else 2]
