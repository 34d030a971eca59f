"""How commands end: the exit code of a run, and an error in one line. As `cell.cli.main` it imports nothing heavy."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from typing import Any, NoReturn

from arm.errors import A465Error, ExecutionStopped
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
