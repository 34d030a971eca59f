"""The command line. This module imports nothing heavy: every command imports what it needs when it runs."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from arm.errors import A465Error, ExecutionStopped, ImpossibleError, InputError
from cell.cli_calibrate import app as calibrate_app
from cell.console import Console, OutputLost, say_on_stderr
from driver.interrupt import interruptible

app = typer.Typer(
    name="a465",
    help="Plan, preview and run motions of a CRS A465 arm in its work cell, or in a simulated one.",
    rich_markup_mode=None,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
app.add_typer(calibrate_app)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"a465 {version('a465')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Every verb answers --help with an example, and --json with one JSON object."""


TaskFile = Annotated[Path, typer.Argument(help="Task file, such as scenes/task2.toml.", metavar="TASK")]
PlanFile = Annotated[Path, typer.Argument(help="Plan file, as written by a465 plan.", metavar="PLAN")]
LookFile = Annotated[Path, typer.Option("--look", help="What was seen, as written by a465 look.")]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output, all else on standard error.")
]
Speed = Annotated[
    float | None, typer.Option("--speed", help="Factor of velocities, 0 < s <= 1; default: the cell file's.")
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
    typer.Option("--time-scale", help="Emulated seconds per wall second (simulated cell only; default: 10)."),
]
Advice = Annotated[
    bool, typer.Option("--advice/--no-advice", help="After a refusal, try what would help, with the planner.")
]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", help="File to write; it replaces an older one.")
]


@app.command(
    help="Do the whole task: look, check reach, plan, stream, look again after each cube, report. "
    "In the simulated cell, or on the real one with --port.",
    epilog="Example: a465 run scenes/task2.toml --speed 0.5",
)
def run(
    task: TaskFile,
    port: Port = None,
    world: WorldFile = None,
    images: Images = None,
    camera: Camera = None,
    speed: Speed = None,
    time_scale: TimeScale = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="New folder of the run; default: runs/TASK-1, -2 ..")
    ] = None,
    advice: Advice = True,
    as_json: Json = False,
) -> None:
    from cell.run import run_task

    console = Console(as_json)
    _finish(console, run_task(task, console, port, world, images, speed, time_scale, output, advice, camera))


@app.command(
    help="Find the boards, their holes and cubes: in photographs, with a camera, or in the simulated cell.",
    epilog="Example: a465 look scenes/task2.toml -o look.json",
)
def look(
    task: Annotated[
        Path | None, typer.Argument(help="Task file, such as scenes/task2.toml.", metavar="TASK")
    ] = None,
    images: Images = None,
    camera: Camera = None,
    detections: Annotated[
        Path | None,
        typer.Option("--detections", help="File of recorded marker corners, instead of photographs."),
    ] = None,
    world: WorldFile = None,
    output: Output = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", help="PNG to write, with what was found.")
    ] = None,
    as_json: Json = False,
) -> None:
    console = Console(as_json)
    if detections is not None:
        others = {"--images": images, "--camera": camera, "--world": world, "--picture": picture}
        for name, given in others.items():
            if given is not None:
                raise InputError(
                    f"{name} does not go with --detections: corners are no photographs", option=name
                )
        from cell.recorded import detections_step

        console.result(detections_step(detections, task, output, console))
        return
    if task is None:
        raise InputError(
            "look: TASK is missing, such as scenes/task2.toml; or give --detections FILE", task=None
        )
    from cell.steps import look_step

    console.result(look_step(task, images, world, output, picture, console, camera))


@app.command(
    help="Say for every hole whether the arm can serve it, on which branches, and by how much not.",
    epilog="Example: a465 reach scenes/task2.toml --look look.json",
)
def reach(task: TaskFile, look: LookFile, advice: Advice = True, as_json: Json = False) -> None:
    from cell.steps import reach_step

    console = Console(as_json)
    console.result(reach_step(task, look, console, advice))


@app.command(
    help="Plan the whole task from what was seen and write the plan file.",
    epilog="Example: a465 plan scenes/task2.toml --look look.json -o plan.json",
)
def plan(
    task: TaskFile,
    look: LookFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Plan file to write.")] = Path("plan.json"),
    speed: Speed = None,
    advice: Advice = True,
    as_json: Json = False,
) -> None:
    from cell.steps import plan_step

    console = Console(as_json)
    console.result(plan_step(task, look, output, speed, console, advice))


@app.command(
    help="Check a plan file again: limits and clearance of everything it would send. "
    "Or a scene file: verdicts and distances against those it expects; with --q, "
    "the closest pairs at any configuration of a scene, cell or task file.",
    epilog="Example: a465 check plan.json scenes/task2.toml -- or: "
    "a465 check scenes/fixtures/capsule.toml --q 0,10,-80,0,-60,0",
)
def check(
    file: Annotated[
        Path,
        typer.Argument(help="Plan file, or scene file such as scenes/fixtures/capsule.toml.", metavar="FILE"),
    ],
    task: Annotated[Path | None, typer.Argument(help="Task file of the plan.", metavar="TASK")] = None,
    q: Annotated[str | None, typer.Option("--q", help="J1 to J6 in deg with commas.", metavar="Q")] = None,
    as_json: Json = False,
) -> None:
    from cell.checkstep import check_step

    console = Console(as_json)
    report = check_step(file, task, q, console)
    console.result(report)
    if report.get("differing"):
        _refuse(f"not as expected: {', '.join(report['differing'])}")


@app.command(
    help="Write a page that shows a plan in 3D, or what a log says was executed over what was planned; "
    "it opens in any browser without a network.",
    epilog="Example: a465 preview plan.json scenes/task2.toml -o plan.html -- or: "
    "a465 preview runs/task2-1/wire.jsonl",
)
def preview(
    file: Annotated[
        Path,
        typer.Argument(help="Plan file, or log of a run such as runs/task2-1/wire.jsonl.", metavar="FILE"),
    ],
    task: Annotated[
        Path | None,
        typer.Argument(help="Task file of the plan; that of a log is found by what it says.", metavar="TASK"),
    ] = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    from cell.previewstep import preview_file

    console = Console(as_json)
    console.result(preview_file(file, task, output, console))


@app.command(
    help="Execute a plan file, if it matches the cell of now: in the simulated cell, or on the arm with --port. "
    "On a terminal: space pauses, + and - change the speed, q or Ctrl-C aborts.",
    epilog="Example: a465 execute plan.json scenes/task2.toml --speed 0.5",
)
def execute(
    plan: PlanFile,
    task: TaskFile,
    port: Port = None,
    world: WorldFile = None,
    images: Images = None,
    camera: Camera = None,
    speed: Annotated[
        float,
        typer.Option("--speed", help="Factor of the plan's velocities, 0 < s <= 1; it only lowers them."),
    ] = 1.0,
    resume: Annotated[
        bool, typer.Option("--resume", help="After a stop: plan what is left anew, from where the arm is.")
    ] = False,
    time_scale: TimeScale = None,
    as_json: Json = False,
) -> None:
    from cell.run import execute_plan, resume_plan

    console = Console(as_json)
    if resume:
        _finish(console, resume_plan(plan, task, console, port, images, None, speed, camera))
        return
    _finish(console, execute_plan(plan, task, console, port, world, images, time_scale, None, speed, camera))


@app.command(
    help="Be a MARS-8 controller with an arm on a pseudo-terminal, until interrupted. "
    "With --task, one among the boards and cubes of a simulated cell; with --fault, one on which things go wrong "
    "as told.",
    epilog="Example: a465 emulate --task scenes/task2.toml --photographs shots --link mars -- or: "
    "a465 emulate --unit crs93 --link mars --fault scenes/faults/noisy-line.toml --log unit.jsonl",
)
def emulate(
    unit: Annotated[
        str | None, typer.Option("--unit", help="crs93 or crs97; default: that of the task, or crs93.")
    ] = None,
    link: Annotated[
        Path | None, typer.Option("--link", help="Symbolic link to make to the pseudo-terminal.")
    ] = None,
    tcp: Annotated[
        int | None, typer.Option("--tcp", help="Listen on this port of the loopback too; 0 takes any.")
    ] = None,
    fault: Annotated[
        Path | None,
        typer.Option("--fault", help="File of faults to come, such as scenes/faults/bad-day.toml."),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option("--log", help="File for every line received and answered, faults and violations."),
    ] = None,
    task: Annotated[
        Path | None, typer.Option("--task", help="Put the arm into the simulated cell of this task file.")
    ] = None,
    world: WorldFile = None,
    photographs: Annotated[
        Path | None,
        typer.Option("--photographs", help="Folder that gets photographs of that cell while the arm stands."),
    ] = None,
    time_scale: Annotated[
        float, typer.Option("--time-scale", help="Emulated seconds per wall second.")
    ] = 1.0,
) -> None:
    from cell.emulating import emulate_step

    emulate_step(unit, link, tcp, time_scale, fault, log, task, world, photographs)


@app.command(
    help="Render photographs of the simulated cell with the arm at q_start.",
    epilog="Example: a465 render scenes/task2.toml -o photographs",
)
def render(
    task: TaskFile,
    world: WorldFile = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder to write.")] = None,
    count: Annotated[int | None, typer.Option("--count", help="How many; default: the cell file's.")] = None,
    target: Annotated[
        str | None,
        typer.Option("--target", help="Of a calibration target instead: a target file, or charuco."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Of the target's poses and of noise.")] = 0,
    as_json: Json = False,
) -> None:
    console = Console(as_json)
    if target is not None:
        from cell.targetstep import target_step

        console.result(target_step(task, target, seed, output or Path("photographs"), count, console))
        return
    from cell.steps import render_step

    console.result(render_step(task, world, output or Path("photographs"), count, console))


@app.command(
    help="Write what a log holds in another form: a table of samples, a ROS 2 JointTrajectory, or MCAP.",
    epilog="Example: a465 export runs/task2-1/wire.jsonl --format csv -o samples.csv",
)
def export(
    log: Annotated[
        Path, typer.Argument(help="Log of a run, such as runs/task2-1/wire.jsonl.", metavar="LOG")
    ],
    form: Annotated[str, typer.Option("--format", help="csv, trajectory or mcap.")] = "csv",
    output: Output = None,
    planned: Annotated[
        bool, typer.Option("--planned", help="Of a trajectory: what was sent, not where the arm was seen.")
    ] = False,
    unit: Annotated[
        str | None, typer.Option("--unit", help="crs93 or crs97; default: what the log tells.")
    ] = None,
    as_json: Json = False,
) -> None:
    from cell.export import export_step

    console = Console(as_json)
    console.result(export_step(log, form, output, planned, unit, console))


def _finish(console: Console, report: dict[str, Any]) -> None:
    """Print the report of a run; a run that left a cube behind does not end with 0."""
    console.result(report)
    left = [cube["from"] for cube in report["cubes"] if not cube["placed"]]
    if left:
        say_on_stderr(f"a465: not done: the cube of {', '.join(left)} was not placed; the arm is at q_start")
        raise typer.Exit(ExecutionStopped.exit_code)


def _refuse(message: str) -> None:
    """End with "refused" after the report was printed."""
    say_on_stderr(f"a465: {message}")
    raise typer.Exit(ImpossibleError.exit_code)


def main() -> None:
    """Run the command line; our errors become one line and their exit code."""
    with interruptible(ends=True):
        try:
            app()
        except A465Error as error:
            _fail(error)


def _fail(error: A465Error) -> None:
    if "--json" in sys.argv and not isinstance(error, OutputLost):
        body = {
            "error": {
                "kind": type(error).__name__,
                "message": str(error),
                "exit_code": error.exit_code,
                **error.data,
            }
        }
        with suppress(OutputLost):  # standard error and the exit code tell as well
            Console().say(json.dumps(body, indent=2, default=str))
    say_on_stderr(f"a465: {error.word}: {error}")
    sys.exit(error.exit_code)
