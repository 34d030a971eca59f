"""Arguments, options and an end that several verbs of the command line share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from arm.errors import ImpossibleError
from cell.console import say_on_stderr

TaskFile = Annotated[Path, typer.Argument(help="Task file, such as scenes/task2.toml.", metavar="TASK")]
PlanFile = Annotated[Path, typer.Argument(help="Plan file, as written by a465 plan.", metavar="PLAN")]
LookFile = Annotated[Path, typer.Option("--look", help="What was seen, as written by a465 look.")]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output, all else on standard error.")
]
Speed = Annotated[
    float | None,
    typer.Option(
        "--speed",
        help="Share of what the speed registers allow, 0.01 to 1; accelerations by its square. Default: motion.speed "
        "of the cell file; of an execution the plan's, which it may only lower.",
    ),
]
WorldFile = Annotated[
    Path | None, typer.Option("--world", help="Truth of the simulated cell; default: TASK with .world.toml.")
]
Port = Annotated[
    str | None,
    typer.Option("--port", help="Serial port of the controller, such as /dev/mars or socket://..."),
]
Images = Annotated[
    Path | None, typer.Option("--images", help="Folder of photographs to look at, in place of a camera.")
]
Camera = Annotated[
    str | None,
    typer.Option(
        "--camera",
        help="Basler camera to look with: name:NAME, serial:NUMBER, ip:ADDRESS, class:CLASS, "
        "or cell for the cell file's.",
        metavar="SELECTOR",
    ),
]
TimeScale = Annotated[
    float | None,
    typer.Option(
        "--time-scale", help="At most so many emulated seconds a second (simulated cell only; default: 10)."
    ),
]
Advice = Annotated[
    bool, typer.Option("--advice/--no-advice", help="After a refusal, try what would help, with the planner.")
]
Budget = Annotated[
    float | None,
    typer.Option(
        "--budget",
        help="Seconds of effort that planning may cost, counted and not timed: the best complete plan by then is "
        "taken, the same one each time.",
        metavar="S",
    ),
]
GiveUp = Annotated[
    float | None,
    typer.Option(
        "--give-up", help="Seconds after which planning is refused; it changes no plan.", metavar="S"
    ),
]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", help="File to write; it replaces an older one.")
]
LiveFlag = Annotated[
    bool, typer.Option("--live", help="Show the run in a browser of this machine, while it runs.")
]
LivePort = Annotated[
    int | None,
    typer.Option("--live-port", help="Port of the live view, on 127.0.0.1; default: any free one."),
]
Unseen = Annotated[
    bool,
    typer.Option(
        "--unseen",
        help="With --port: skip the question for the unit's name; plans are made on the way and not previewed.",
    ),
]
Homed = Annotated[
    bool,
    typer.Option(
        "--homed",
        help="With --port: do not home; you state that the unit was homed since power-up, which it cannot tell.",
    ),
]
Preload = Annotated[
    bool,
    typer.Option(
        "--preload",
        help="For a bad line: load each motion (its first 149 segments) into the unit and verify it before it begins; "
        "what was damaged is sent again.",
    ),
]
Free = Annotated[
    bool,
    typer.Option(
        "--free",
        help="With --port: skip both questions of homing: its way is clear, and boards stand where they should.",
    ),
]


def refuse(message: str) -> None:
    """End with "refused" after the report was printed."""
    say_on_stderr(f"a465: {message}")
    raise typer.Exit(ImpossibleError.exit_code)
