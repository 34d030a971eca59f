"""Where the program begins: an interrupt is told in one line from the first moment, also while modules are loaded."""

from __future__ import annotations

import sys

from driver.line.signals import caught, interruptible

INTERRUPTED = 130  # exit code of a command that was interrupted, as shells have it


def main() -> None:
    """Run the command line. Where an arm is open, the command itself tells of an interrupt (`cell.commands.run`)."""
    with interruptible(ends=True):
        try:
            from cell.cli.main import main as run

            run()
        except KeyboardInterrupt:
            caught()
            _tell()
            sys.exit(INTERRUPTED)
        except SystemExit as end:
            caught()
            if end.code == INTERRUPTED:
                _tell()
            raise


def _tell() -> None:
    from cell.console import say_on_stderr

    say_on_stderr("a465: interrupted; nothing that was being written is half there")
