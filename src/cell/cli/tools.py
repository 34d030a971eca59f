"""The verbs of the command line around the main job. Like `cell.cli.main`, this module imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cell.cli.options import Json, TaskFile, WorldFile, refuse
from cell.console import Console

tools = typer.Typer()  # `cell.cli.main` takes its verbs over


@tools.command(
    short_help="Be a MARS-8 controller with an arm, for rehearsals.",
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
    hand: Annotated[
        Path | None,
        typer.Option("--hand", help="Target that the gripper holds, such as scenes/targets/hand.toml."),
    ] = None,
    time_scale: Annotated[float, typer.Option("--time-scale", help="Emulated seconds a second.")] = 1.0,
) -> None:
    from cell.commands.emulate import emulate_step

    emulate_step(unit, link, tcp, time_scale, fault, log, task, world, photographs, hand)


@tools.command(
    short_help="Render photographs of the simulated cell.",
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
        with console.doing("rendering"):
            from cell.commands.calibration.render_target import target_step

            result = target_step(task, target, seed, output or Path("photographs"), count, console)
    else:
        with console.doing("rendering"):
            from cell.commands.steps import render_step

            result = render_step(task, world, output or Path("photographs"), count, console)
    console.result(result)


@tools.command(
    short_help="Write a log, a plan or a scene as CSV, ROS, MCAP or URDF.",
    help="Write a log or a plan in another form: a table of samples, a ROS 2 JointTrajectory, or MCAP. "
    "Or the arm and what stands around it, of a plan, scene, cell or task file: URDF and SRDF in a folder.",
    epilog="Example: a465 export runs/task2-1/wire.jsonl --format csv -o samples.csv -- or: "
    "a465 export scenes/cell.toml -o cell_description",
)
def export(
    file: Annotated[
        Path,
        typer.Argument(
            help="Log of a run, plan, scene, cell or task file; told by what is in it.", metavar="FILE"
        ),
    ],
    form: Annotated[
        str | None,
        typer.Option("--format", help="csv, trajectory, mcap or urdf; default: csv, of a scene urdf."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File to write; of urdf a new folder.")
    ] = None,
    planned: Annotated[
        bool,
        typer.Option("--planned", help="Of a log's trajectory: what was sent, not where the arm was seen."),
    ] = False,
    unit: Annotated[
        str | None, typer.Option("--unit", help="Of a log: crs93 or crs97; default: what it tells.")
    ] = None,
    period: Annotated[
        float | None, typer.Option("--period", help="Of a plan: seconds between samples; default: 0.02.")
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option("--cell", help="Of a plan for a calibrated arm: its cell or task file."),
    ] = None,
    look: Annotated[
        Path | None, typer.Option("--look", help="Of a cell or task file: what was seen, put into it.")
    ] = None,
    as_json: Json = False,
) -> None:
    console = Console(as_json)
    with console.doing("exporting"):
        from cell.export.export import Asked, export_file

        asked = Asked(form, output, planned, unit, period, cell, look)
        result = export_file(file, asked, console)
    console.result(result)


@tools.command(
    name="new-cell",
    short_help="Write a commented cell of your own to start from.",
    help="Write a cell of your own to start from, with a task of each kind, into a new or empty folder: every value "
    "with what to measure. It works in the simulated cell at once.",
    epilog="Example: a465 new-cell my-cell --unit crs97",
)
def new_cell(
    folder: Annotated[Path, typer.Argument(help="New or empty folder.", metavar="DIR")],
    unit: Annotated[
        str | None, typer.Option("--unit", help="Which arm it is: crs93 or crs97; asked for.")
    ] = None,
    name: Annotated[
        str | None, typer.Option("--name", help="What the cell is called; default: as the folder.")
    ] = None,
    as_json: Json = False,
) -> None:
    from cell.commands.new_cell import new_cell_step

    console = Console(as_json)
    console.result(new_cell_step(folder, unit, name, console))


@tools.command(
    short_help="Look whether everything is there and works.",
    help="Look whether everything is there and works: libraries, ports, cameras, a cell and its calibrations, and a "
    "self-test of five seconds. Nothing moves. Exit code 3 if something is wrong.",
    epilog="Example: a465 doctor --cell scenes/task2.toml --port /dev/mars --camera name:camera-crs93",
)
def doctor(
    port: Annotated[
        str | None,
        typer.Option(
            "--port", help="Ask the controller on this port who it is, by ECHO, STAMP and VER alone."
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            "--camera",
            help="Take a photograph with this Basler camera: name:NAME, serial:NUMBER, ip:ADDRESS, class:CLASS, or "
            "cell for the cell file's.",
            metavar="SELECTOR",
        ),
    ] = None,
    cell: Annotated[
        Path | None,
        typer.Option(
            "--cell", help="Cell or task file to look at; default: the built-in one.", metavar="CELL"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    from cell.doctor.doctor import doctor_step

    console = Console(as_json)
    report = doctor_step(port, camera, cell, console)
    console.result(report)
    if report["wrong"]:
        refuse(f"doctor: wrong: {', '.join(report['wrong'])}")
