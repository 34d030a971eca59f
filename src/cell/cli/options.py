"""Arguments, options and an exit that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arm.errors import ImpossibleError
from cell.console import say_on_stderr

TaskFile = Annotated[Path, typer.Argument(help="Task file, such as scenes/task2.toml.", metavar="TASK")]
PlanFile = Annotated[Path, typer.Argument(help="Plan file, as written by a465 plan.", metavar="PLAN")]
LookFile = Annotated[Path, typer.Option("--look", help="File of detected boards, as written by a465 look.")]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output, the rest on standard error.")
]
Speed = Annotated[
    float | None,
    typer.Option(
        "--speed",
        help="Fraction of the speed registers, 0.01 to 1; accelerations scale with its square. Default: motion.speed "
        "of the cell file. An execution defaults to the plan's value and may only lower it.",
    ),
]
WorldFile = Annotated[
    Path | None,
    typer.Option("--world", help="Ground truth of the simulated cell; default: TASK with .world.toml."),
]
Port = Annotated[
    str | None,
    typer.Option("--port", help="Serial port of the controller, such as /dev/mars or socket://..."),
]
Images = Annotated[
    Path | None, typer.Option("--images", help="Folder of images to use in place of a camera.")
]
Camera = Annotated[
    str | None,
    typer.Option(
        "--camera",
        help="Basler camera: name:NAME, serial:NUMBER, ip:ADDRESS, class:CLASS, "
        "or cell for the one in the cell file.",
        metavar="SELECTOR",
    ),
]
TimeScale = Annotated[
    float | None,
    typer.Option("--time-scale", help="Most emulated seconds per second (simulated cell only); default: 10."),
]
Advice = Annotated[
    bool, typer.Option("--advice/--no-advice", help="After a refusal, search for a change that would help.")
]
Budget = Annotated[
    float | None,
    typer.Option(
        "--budget",
        help="Planning effort in nominal seconds. It is counted, not timed, so the result is repeatable: the best "
        "complete plan within the budget.",
        metavar="S",
    ),
]
GiveUp = Annotated[
    float | None,
    typer.Option(
        "--give-up",
        help="Stop planning with a refusal after this wall time; it changes no plan.",
        metavar="S",
    ),
]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", help="File to write; an existing one is replaced.")
]
LiveFlag = Annotated[bool, typer.Option("--live", help="Show the run live in a browser on this machine.")]
LivePort = Annotated[
    int | None,
    typer.Option("--live-port", help="Port of the live view on 127.0.0.1; default: any free port."),
]
Unseen = Annotated[
    bool,
    typer.Option(
        "--unseen",
        help="With --port: do not ask for the arm's name before executing plans that have no preview.",
    ),
]
Homed = Annotated[
    bool,
    typer.Option(
        "--homed",
        help="With --port: do not home; you state that the unit was homed since power-up. It cannot be verified.",
    ),
]
Preload = Annotated[
    bool,
    typer.Option(
        "--preload",
        help="For a noisy serial line: load each motion (its first 149 segments) into the unit and verify it before "
        "it begins; damaged segments are sent again.",
    ),
]
Free = Annotated[
    bool,
    typer.Option(
        "--free",
        help="With --port: home without asking; you state that the arm's reach is clear and the boards are in place.",
    ),
]


def refuse(message: str) -> None:
    """Exit as "refused" after the report has been printed."""
    say_on_stderr(f"a465: {message}")
    raise typer.Exit(ImpossibleError.exit_code)
