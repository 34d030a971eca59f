"""Entry point of the program. It reports an interrupt in one line, even while modules are still loading."""

from __future__ import annotations

import io
import sys

from driver.line.signals import caught, interruptible

INTERRUPTED = 130  # exit code of an interrupted command, as in shells


def main() -> None:
    """Run the command line. Commands with an open arm report an interrupt themselves (`cell.commands.run`)."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a name that the terminal's encoding lacks
    with interruptible(ends=True):
        try:
            from cell.cli.main import main as run

            run()
        except KeyboardInterrupt:
            caught()
            _report()
            sys.exit(INTERRUPTED)
        except SystemExit as end:
            caught()
            if end.code == INTERRUPTED:
                _report()
            raise


def _report() -> None:
    from cell.console import say_on_stderr

    say_on_stderr("a465: interrupted; no file was left half-written")
