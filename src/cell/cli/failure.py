"""Report an error in one line and exit with the code of its kind."""

from __future__ import annotations

import json
import sys
from contextlib import suppress

from arm.errors import A465Error
from cell.console import Console, OutputLost, say_on_stderr


def fail(error: A465Error) -> None:
    """Print the error, with ``--json`` also as an object, and exit."""
    if "--json" in sys.argv and not isinstance(error, OutputLost):
        body = {
            "error": {
                "kind": type(error).__name__,
                "message": str(error),
                "exit_code": error.exit_code,
                **error.data,
            }
        }
        with suppress(OutputLost):  # standard error and the exit code report it too
            Console().say(json.dumps(body, indent=2, default=str))
    say_on_stderr(f"a465: {error.word}: {error}")
    sys.exit(error.exit_code)
