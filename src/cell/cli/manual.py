"""Commands for a person beside the arm. Like `cell.cli.main`, this module imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from cell.cli import options as shared
from cell.cli.options import examples
from cell.console import Console

manual = typer.Typer()  # `cell.cli.main` registers these commands
_PORT = "Serial port of the controller, such as /dev/mars or socket://..."
_Port = Annotated[str, Argument(help=_PORT, metavar="PORT")]
_CELL = "Cell or task file: the unit, its calibration and the tool; default: the unit by its gripper's axis."
_Cell = Annotated[Path | None, Option("--cell", help=_CELL, metavar="CELL")]


@manual.command(
    short_help="Tell where the arm is and what has the port; nothing moves.",
    help="Tell where the arm is, its power and errors, and which a465 has the port since when. Only queries are sent; "
    "while another a465 has the port, its log is read instead.",
    epilog=examples("a465 status /dev/mars --cell scenes/cell.toml"),
)
def status(port: _Port, cell: _Cell = None, as_json: shared.Json = False) -> None:
    console = Console(as_json)
    from cell.commands.manual.status import status_step

    console.result(status_step(port, cell, console))


@manual.command(
    short_help="Stop the arm at once, whatever has the port.",
    help="Stop the arm at once: STOP is sent without a question. If another a465 has the port, it is interrupted as by "
    "Ctrl-C, and ends. The arm stays under power. The emergency stop is the button, not this command.",
    epilog=examples("a465 stop /dev/mars"),
)
def stop(port: _Port, as_json: shared.Json = False) -> None:
    console = Console(as_json)
    from cell.commands.manual.stop import stop_step

    console.result(stop_step(port, console))
