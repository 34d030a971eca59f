"""Auxiliary commands of the command line. Like `cell.cli.main`, this module imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from arm.errors import InputError
from cell.cli import options as shared
from cell.cli.options import SELECTORS, TRIED, answering, examples, refuse, refuse_given
from cell.console import Console

tools = typer.Typer()  # `cell.cli.main` registers these commands
_DOCTOR_PORT = (
    "Identify the controller on this port, or on the cell's (cell), sending only ECHO, STAMP and VER; with --cell also "
    "ask whether the arm is homed, and for its registers."
)
_ASK = "With --cell: ask at the terminal for what of the first-day checklist only a person sees; keep the answers."
_LOG = "Log to write: every line received and sent, faults and protocol violations."
_EXPORTED = "Log of a run, or plan, scene, cell, task, program or arm file; recognised by its content."
_FORM = "csv, trajectory, mcap or urdf; default: csv for a log or plan, otherwise urdf."


@tools.command(
    short_help="Emulate a MARS-8 controller with an arm, for rehearsals.",
    help="Emulate a MARS-8 controller with an arm on a pseudo-terminal, until interrupted. "
    "--task puts the arm into a simulated cell with boards and cubes; --fault injects the faults of a file.",
    epilog=examples(
        "a465 emulate --task scenes/task2.toml --photographs shots --link mars",
        "a465 emulate --unit crs93 --link mars --fault scenes/faults/noisy-line.toml --log unit.jsonl",
    ),
)
def emulate(
    context: typer.Context,
    unit: Annotated[
        str | None, Option(help="crs93, crs97 or a unit file; default: that of the task, else crs93.")
    ] = None,
    link: Annotated[
        Path | None, Option(help="Symbolic link to create, which points to the pseudo-terminal.")
    ] = None,
    tcp: Annotated[
        int | None, Option(help="Also listen on this TCP port of 127.0.0.1; 0 takes any free one.")
    ] = None,
    fault: Annotated[
        Path | None, Option(help="File of faults to inject, such as scenes/faults/bad-day.toml.")
    ] = None,
    log: Annotated[Path | None, Option(help=_LOG)] = None,
    task: Annotated[Path | None, Option(help="Task file of the simulated cell.")] = None,
    world: shared.WorldFile = None,
    photographs: Annotated[
        Path | None, Option(help="Folder for images of the simulated cell, taken while the arm stands still.")
    ] = None,
    hand: Annotated[
        Path | None, Option(help="Target in the gripper, such as scenes/targets/hand.toml.")
    ] = None,
    time_scale: Annotated[float, Option(help="Emulated seconds per second.")] = 1.0,
) -> None:
    from cell.commands.emulate import emulate_step

    if task is None:
        refuse_given(context, ("world", "photographs", "hand"), "needs --task: there is no cell without it")
    emulate_step(unit, link, tcp, time_scale, fault, log, task, world, photographs, hand)


@tools.command(
    short_help="Render images of the simulated cell.",
    help="Render images of the simulated cell with the arm at q_start.",
    epilog=examples("a465 render scenes/task2.toml -o photographs"),
)
def render(
    task: shared.TaskFile,
    world: shared.WorldFile = None,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Folder to write; default: photographs.")
    ] = None,
    count: Annotated[int | None, Option(help="Number of images; default: as in the cell file.")] = None,
    target: Annotated[
        str | None, Option(help="Render a calibration target instead: a target file, or charuco.")
    ] = None,
    seed: Annotated[int, Option(help="Seed of the target's poses and of the noise.")] = 0,
    as_json: shared.Json = False,
) -> None:
    folder = output or Path("photographs")
    with answering("rendering", as_json) as console:
        from cell.commands.render import render_step

        console.result(render_step(task, world, folder, count, console, target, seed))


@tools.command(
    short_help="One table of many runs: results, faults, causes and times.",
    help="One table of many runs, such as those of a day: how each ended, cubes placed, what went wrong and was "
    "recovered, errors and times. Reads report.json of each run folder.",
    epilog=examples("a465 report runs -o day.html"),
)
def report(
    folders: Annotated[
        list[Path] | None,
        Argument(help="Run folders, or folders of them; default: runs.", metavar="[RUNS]..."),
    ] = None,
    output: Annotated[Path | None, Option("-o", "--output", help="Page to write.")] = None,
    as_json: shared.Json = False,
) -> None:
    with answering("reading", as_json) as console:
        from cell.commands.report import report_step

        console.result(report_step(folders or (), output, console))


@tools.command(
    short_help="List the run folders that are kept; remove old ones.",
    help="List the run folders in a folder: when each was written last, of what it is, how it ended, its size. "
    "--prune removes old ones: it lists them and asks first. A folder without a run's log or report stays.",
    epilog=examples("a465 runs", "a465 runs --prune 30"),
)
def runs(
    context: typer.Context,
    folder: Annotated[
        Path | None, Argument(help="Folder of run folders; default: runs.", metavar="[RUNS]")
    ] = None,
    prune: Annotated[
        float | None, Option(help="Remove runs that were not written to for so many days, 1 or more.")
    ] = None,
    yes: Annotated[bool, Option("--yes", help="Remove them without a question.")] = False,
    as_json: shared.Json = False,
) -> None:
    from cell.commands.report import runs_step

    if prune is None:
        refuse_given(context, ("yes",), "needs --prune DAYS: without it nothing is removed")
    console = Console(as_json)
    console.result(runs_step(folder, prune, yes, console))


@tools.command(
    short_help="Export a log, a plan or a scene as CSV, ROS, MCAP or URDF.",
    help="Export a log or a plan as a table of samples, a ROS 2 JointTrajectory, or MCAP. "
    "Or export the arm and its surroundings from a plan, scene, cell, task, program or arm file as a folder with "
    "URDF and SRDF.",
    epilog=examples(
        "a465 export runs/task2-1/wire.jsonl --format csv -o samples.csv",
        "a465 export scenes/cell.toml -o cell_description",
    ),
)
def export(
    file: Annotated[Path, Argument(help=_EXPORTED, metavar="FILE")],
    form: Annotated[str | None, Option("--format", help=_FORM)] = None,
    output: Annotated[
        Path | None, Option("-o", "--output", help="File to write; for urdf a new folder.")
    ] = None,
    planned: Annotated[
        bool, Option("--planned", help="For the trajectory of a log: as sent, not as measured.")
    ] = False,
    unit: Annotated[
        str | None, Option(help="For a log: crs93, crs97 or a unit file; default: the unit named in the log.")
    ] = None,
    period: Annotated[float | None, Option(help="For a plan: sampling period in s; default: 0.02.")] = None,
    cell: Annotated[
        Path | None,
        Option(
            help="For a plan of a calibrated arm: its cell or task file; or the arm file to compare with. For a log "
            "as mcap: the cell file to show; default: the one that it names."
        ),
    ] = None,
    look: Annotated[Path | None, Option(help="For a cell or task file: detected boards to include.")] = None,
    as_json: shared.Json = False,
) -> None:
    with answering("exporting", as_json) as console:
        from cell.export.export import ExportOptions, export_file

        options = ExportOptions(form, output, planned, unit, period, cell, look)
        console.result(export_file(file, options, console))


@tools.command(
    short_help="Show a cell or an arm in 3D on an HTML page, with no plan.",
    help="Write an HTML page that shows the arm and what stands around it in 3D: of a cell, task, program or arm file, "
    "with boards and cubes if a look is given. Two bodies inside each other are red. With --live the page follows the "
    "arm: its unit is only asked, or the log of the a465 that has the port is read.",
    epilog=examples(
        "a465 view scenes/hoop/d.toml", "a465 view scenes/cell.toml --q 0,10,-80,0,-60,0 -o there.html"
    ),
)
def view(
    context: typer.Context,
    place: Annotated[Path, Argument(help="Cell, task, program or arm file.", metavar="FILE")],
    look: Annotated[Path | None, Option(help="For a cell or task file: detected boards to include.")] = None,
    image: shared.Photograph = None,
    q: Annotated[
        str | None,
        Option("--q", help="Where the arm is, J1 to J6 in deg; default: q_start.", metavar="ANGLES"),
    ] = None,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Page to write; default: named as FILE, in this folder.")
    ] = None,
    live: Annotated[
        bool, Option("--live", help="Serve the page, with the arm where its unit reports it, until Ctrl-C.")
    ] = False,
    port: Annotated[
        str | None, Option(help="With --live: the controller's; default: the cell file's, or A465_PORT.")
    ] = None,
    live_port: shared.LivePort = None,
    seconds: Annotated[float | None, Option(help="With --live: how long; default: until Ctrl-C.")] = None,
    as_json: shared.Json = False,
) -> None:
    if live:
        shared.refuse_given(context, ("q", "output"), "cannot be combined with --live")
        console = Console(as_json)
        from cell.commands.viewing.live_arm import view_live_step

        console.result(view_live_step(place, look, image, port, live_port, seconds, console))
        return
    shared.refuse_given(context, ("port", "live_port", "seconds"), "goes with --live")
    with answering("drawing", as_json) as console:
        from cell.preview.of_place import view_step

        console.result(view_step(place, look, q, output, console, image))


@tools.command(
    short_help="Prove or refute a trajectory that another program made.",
    help="Prove or refute a joint trajectory that another program made: limits of the joints, and the clearance of all "
    "bodies, also between its points. It is a ROS JointTrajectory as JSON; joints move on straight lines between "
    "points, or on cubics if points have velocities. The exit code is 3 if it is refuted, which names the pair and "
    "the moment.",
    epilog=examples(
        "a465 certify plan.trajectory.json scenes/cell.toml",
        "a465 certify moveit.json scenes/task2.toml --look look.json --clearance-mm 3 -o plan.json",
    ),
)
def certify(
    trajectory: Annotated[
        Path, Argument(help="trajectory_msgs/JointTrajectory as JSON.", metavar="TRAJECTORY")
    ],
    place: Annotated[Path, Argument(help="Scene, cell, task, program or arm file.", metavar="FILE")],
    look: Annotated[Path | None, Option(help="For a cell or task file: detected boards to include.")] = None,
    clearance_mm: Annotated[
        float | None,
        Option(help="Clearance to prove; default: that of the file, 0 of a scene.", metavar="MM"),
    ] = None,
    speed: shared.Speed = None,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Plan file to write, for a465 preview, check and execute.")
    ] = None,
    page: Annotated[
        Path | None, Option(help="Preview to write, also of a refused trajectory: it shows where and why.")
    ] = None,
    as_json: shared.Json = False,
) -> None:
    with answering("certifying", as_json) as console:
        from cell.foreign.certify import certify_step

        clearance = None if clearance_mm is None else clearance_mm / 1e3
        console.result(certify_step(trajectory, place, look, clearance, speed, output, page, console))


@tools.command(
    short_help="What changed between two cells, tasks, calibrations or plans.",
    help="List what changed from one cell, task, program, camera, calibration or plan file to another: keys with both "
    "values, how far camera and joint offsets moved, with standard deviations, and motions with their times and "
    "clearances. Files that both name are compared too.",
    epilog=examples(
        "a465 compare scenes/realistic/calibration.toml new/calibration.toml",
        "a465 compare scenes/cell.toml my-cell/cell.toml",
    ),
)
def compare(
    first: Annotated[Path, Argument(help="Cell, task, program, calibration or plan file.", metavar="FIRST")],
    second: Annotated[Path, Argument(help="Another one of its kind.", metavar="SECOND")],
    as_json: shared.Json = False,
) -> None:
    from cell.compare.compare import compare_step

    console = Console(as_json)
    console.result(compare_step(first, second, console))


@tools.command(
    name="new-cell",
    short_help="Create a commented cell of your own to start from.",
    help="Create a cell of your own, with a task of each kind, in a new or empty folder. Comments explain every "
    "value and how to measure it. The cell works in simulation at once.",
    epilog=examples("a465 new-cell my-cell --unit crs97"),
)
def new_cell(
    folder: Annotated[Path, Argument(help="New or empty folder.", metavar="DIR")],
    unit: Annotated[
        str | None,
        Option(
            help="Arm of the cell, which cannot be detected: crs93, crs97 or a unit file, which is copied. Without "
            "it a person at the terminal is asked, also for port, camera and gripper."
        ),
    ] = None,
    name: Annotated[str | None, Option(help="Name of the cell; default: that of the folder.")] = None,
    as_json: shared.Json = False,
) -> None:
    from cell.commands.new_cell import new_cell_step
    from cell.session.dialogue import at_terminal, typed

    console = Console(as_json)
    answer = typed if at_terminal() and not as_json else None
    console.result(new_cell_step(folder, unit, name, console, answer))


@tools.command(
    short_help="Check the installation, the devices and a cell.",
    help="Check libraries, ports, cameras, a cell and its calibrations, and run a self-test of five seconds. "
    "With --cell tick off the cell's first-day checklist, kept beside it: what must be true before the arm may run "
    "unattended. Nothing moves. The exit code is 3 if something is wrong.",
    epilog=examples(
        "a465 doctor --cell scenes/task2.toml --port /dev/mars --camera name:camera-crs93",
        "a465 doctor --cell my-cell/cell.toml --ask -o checklist.html",
    ),
)
def doctor(
    context: typer.Context,
    port: Annotated[str | None, Option(help=_DOCTOR_PORT)] = None,
    camera: Annotated[
        str | None, Option(help=f"Take an image with this camera: {SELECTORS} {TRIED}", metavar="SELECTOR")
    ] = None,
    cell: Annotated[
        Path | None, Option(help="Cell or task file to check; default: the built-in one.", metavar="CELL")
    ] = None,
    ask: Annotated[bool, Option("--ask", help=_ASK)] = False,
    output: Annotated[
        Path | None, Option("-o", "--output", help="With --cell: page of the checklist to write.")
    ] = None,
    as_json: shared.Json = False,
) -> None:
    from cell.doctor.doctor import doctor_step, wrong_in

    if cell is None:
        refuse_given(context, ("ask", "output"), "needs --cell: the built-in cell has no checklist")
    console, answer = Console(as_json), None
    if ask:
        from cell.session.dialogue import at_terminal, typed

        if not at_terminal():
            raise InputError("--ask: there is no terminal at which a person can answer", option="--ask")
        answer = typed
    if port == "cell":  # what finds that port needs libraries, which may be missing otherwise
        from cell.session.ports import choose_port

        port = choose_port(port, cell, console)
    report = doctor_step(port, camera, cell, console, answer, output)
    console.result(report)
    if report["wrong"]:
        refuse(wrong_in(report))


@tools.command(
    short_help="Ask one question of many cells, such as where boards may stand.",
    help="Evaluate many cells that differ in a few values: can every hole be reached, the boards be seen, the task be "
    "planned and run? Each refusal has its reason. Finished chunks are kept: the same command goes on where it ended.",
    epilog=examples(
        "a465 study scenes/where-boards-may-stand.toml",
        "a465 study scenes/where-boards-may-stand.toml --point 23",
    ),
)
def study(
    file: Annotated[
        Path, Argument(help="Study file, such as scenes/where-boards-may-stand.toml.", metavar="FILE")
    ],
    output: Annotated[
        Path | None,
        Option(
            "-o",
            "--output",
            help="Folder of the results; default: study-NAME, with --point study-NAME-NUMBER.",
            metavar="FOLDER",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        Option(min=0, help="Processes; 0: this one alone. Default: one per processor.", metavar="N"),
    ] = None,
    scheduler: Annotated[
        str | None,
        Option(help="Dask scheduler whose workers compute, such as tcp://127.0.0.1:8786.", metavar="ADDRESS"),
    ] = None,
    best: Annotated[
        Path | None, Option(help="New folder for the files of the most robust point.", metavar="FOLDER")
    ] = None,
    point: Annotated[
        int | None, Option(help="Write the files of this point with its look and its plan.", metavar="NUMBER")
    ] = None,
    as_json: shared.Json = False,
) -> None:
    with answering("studying", as_json) as console:
        from cell.study.command import point_step, study_step

        if point is None:
            console.result(study_step(file, output, workers, scheduler, best, console))
        elif workers is None and scheduler is None and best is None:
            console.result(point_step(file, point, output, console))
        else:
            raise InputError("--point: needs no --workers, --scheduler or --best", option="point")
