"""The main commands. This module imports nothing heavy: every command imports what it needs when it runs."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from arm.errors import MOST_MESSAGE, A465Error, InputError, shortened
from arm.io.storage import one_command
from cell.cli import options as shared
from cell.cli.calibrate import app as calibrate_app
from cell.cli.ending import fail, fail_usage, finish
from cell.cli.groups import GroupedCommands, built_for
from cell.cli.manual import manual
from cell.cli.options import NO_PORT, WITH_PORT, answering, examples, pictured, refuse, refuse_given
from cell.cli.tools import tools
from cell.cli.typed import refuse_mistyped
from driver.line.signals import interruptible

app = typer.Typer(
    name="a465",
    cls=GroupedCommands,
    help="Plan, preview and execute motions of a CRS A465 arm in its cell, real or simulated.",
    rich_markup_mode=None,
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
)
app.add_typer(calibrate_app)
_LOOK = "Boards as written by a465 look; a program needs it if its workpiece is on one."
_SEEN = "Boards as written by a465 look; needed by a task, and by a program whose workpiece is on one."


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"a465 {version('a465')}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Global options."""


@app.command(
    short_help="Run a whole task: look, plan, execute, look again, report.",
    help="Run a whole task or program, in the simulated cell or in the real one with --port: look, check reach, plan, "
    "execute, look again after each cube, report.",
    epilog=examples("a465 run scenes/task2.toml --speed 0.5"),
)
def run(
    context: typer.Context,
    task: shared.ProgramFile,
    port: shared.Port = None,
    world: shared.WorldFile = None,
    images: shared.Images = None,
    camera: shared.Camera = None,
    speed: shared.Speed = None,
    time_scale: shared.TimeScale = None,
    cell: shared.SimulatedAs = shared.CellKind.IDEAL,
    output: Annotated[
        Path | None, Option("-o", "--output", help="New folder of the run; default: runs/TASK-1, -2, ...")
    ] = None,
    advice: shared.Advice = True,
    budget: shared.Budget = None,
    give_up: shared.GiveUp = None,
    unseen: shared.Unseen = False,
    homed: shared.Homed = False,
    free: shared.Free = False,
    preload: shared.Preload = False,
    live: shared.LiveFlag = False,
    live_port: shared.LivePort = None,
    as_json: shared.Json = False,
) -> None:
    if port is None:
        refuse_given(context, ("unseen", "homed", "free"), NO_PORT)
    else:
        refuse_given(context, ("cell",), WITH_PORT)
    with answering("starting", as_json) as console:
        from cell.commands.run import run_task
        from cell.session.budget import budget_of
        from cell.session.connection import WhichCell
        from cell.session.ports import choose_port
        from cell.task.approval import Consent
        from cell.task.free_cell import FreeCell

    allowed = budget_of(budget, give_up)
    port = None if port is None else choose_port(port, task, console)
    confirm = None if port is None else FreeCell(Consent(unseen, console), port, homed or free, console)
    contact = cell == shared.CellKind.MUJOCO
    where = WhichCell(port, world, images, camera, speed, time_scale, homed, preload, contact)
    with shared.watched(console, live, live_port) as watcher:
        finish(console, run_task(task, console, where, output, advice, confirm, watcher, allowed))


@app.command(
    short_help="Detect the boards, their holes and cubes.",
    help="Detect the boards, their holes and cubes: in image files, with a camera, or in the simulated cell.",
    epilog=examples("a465 look scenes/task2.toml -o look.json"),
)
def look(
    context: typer.Context,
    task: Annotated[
        Path | None, Argument(help="Task file, such as scenes/task2.toml.", metavar="TASK")
    ] = None,
    images: shared.Images = None,
    camera: shared.LookCamera = None,
    detections: Annotated[
        Path | None, Option(help="File of recorded marker corners to use instead of images.")
    ] = None,
    world: shared.WorldFile = None,
    output: shared.Output = None,
    picture: Annotated[Path | None, Option(help="PNG to write, annotated with the detections.")] = None,
    as_json: shared.Json = False,
) -> None:
    if detections is not None:
        with_images = "cannot be combined with --detections, which needs no images"
        refuse_given(context, ("images", "camera", "world", "picture"), with_images)
        with answering("looking", as_json) as console:
            from cell.commands.look_recorded import detections_step

            console.result(detections_step(detections, task, output, console))
        return
    if task is None:
        raise InputError("look: give a TASK file, such as scenes/task2.toml, or --detections FILE", task=None)
    with answering("looking", as_json) as console:
        from cell.commands.steps import look_step

        console.result(look_step(task, images, world, output, picture, console, camera))


@app.command(
    short_help="Report which holes or stations of paths the arm can reach.",
    help="Report for every hole, or every station of a program's paths, whether the arm can reach it, "
    "on which inverse-kinematics branches or with how many solutions, and what limits it. The solutions of a "
    "station are counted over samples of its free directions, within the joint limits, before collision checks.",
    epilog=examples("a465 reach scenes/task2.toml --look look.json"),
)
def reach(
    task: shared.ProgramFile,
    look: Annotated[Path | None, Option(help=_LOOK)] = None,
    advice: shared.Advice = True,
    page: shared.RefusalPage = None,
    as_json: shared.Json = False,
) -> None:
    with answering("checking reach", as_json) as console, pictured(page, task, look, console):
        from cell.program.program_file import is_program

        if is_program(task):
            from cell.commands.plan_poses import reach_program_step

            console.result(reach_program_step(task, look, console))
            return
        from cell.commands.steps import reach_step, required_look

        console.result(reach_step(task, required_look(look, task), console, advice))


@app.command(
    short_help="Plan a task, a program, or a motion through a list of poses.",
    help="Plan a whole task from the detected boards, a program, or a collision-free motion through a list of poses "
    "and joint angles, and write the plan file. docs/interop.md describes lists, docs/adding.md files of other arms.",
    epilog=examples(
        "a465 plan scenes/task2.toml --look look.json -o plan.json",
        "a465 plan scenes/hoop/b.toml",
        "a465 plan scenes/cell.toml poses.npy --frame flange --back",
    ),
)
def plan(
    place: Annotated[
        Path,
        Argument(
            help="Task or program file; with POSES, the task, cell or arm file of the arm that moves.",
            metavar="FILE",
        ),
    ],
    poses: Annotated[
        Path | None, Argument(help="List of poses: JSON, CSV or .npy.", show_default=False)
    ] = None,
    look: Annotated[Path | None, Option(help=_SEEN)] = None,
    output: shared.PlanOutput = Path("plan.json"),
    frame: Annotated[
        str | None, Option(help="Frame of poses that do not name one: flange (as in ctu_crs) or tool.")
    ] = None,
    angles: Annotated[str | None, Option(help="Unit of angles that do not name one: rad or deg.")] = None,
    lengths: Annotated[str | None, Option(help="Unit of the poses' positions: m or mm. Default: m.")] = None,
    back: Annotated[bool, Option("--back", help="Return to q_start after the last pose.")] = False,
    speed: shared.Speed = None,
    advice: shared.Advice = True,
    budget: shared.Budget = None,
    give_up: shared.GiveUp = None,
    page: shared.RefusalPage = None,
    as_json: shared.Json = False,
) -> None:
    with answering("planning", as_json) as console, pictured(page, place, look, console, output):
        from cell.session.budget import budget_of

        allowed = budget_of(budget, give_up)
        if poses is not None:
            from cell.commands.plan_poses import plan_poses_step
            from cell.files.reading import reading_of

            reading = reading_of(frame, angles, lengths)
            console.result(
                plan_poses_step(place, poses, look, output, reading, speed, back, console, allowed, advice)
            )
            return
        of_lists = {"--frame": frame, "--angles": angles, "--lengths": lengths, "--back": back or None}
        if given := [name for name, value in of_lists.items() if value is not None]:
            raise InputError(
                f"{given[0]} is for a list of poses, and none is given: a465 plan FILE POSES", option=given[0]
            )
        from cell.program.program_file import is_of_poses, is_program

        if is_of_poses(place):
            why = f"{place} is no task and no program; a list of poses has to follow it: a465 plan {place} POSES"
            raise InputError(why, file=str(place))
        if is_program(place):
            from cell.commands.plan_poses import plan_program_step

            console.result(plan_program_step(place, look, output, speed, console, advice, allowed))
            return
        from cell.commands.steps import plan_step, required_look

        look = required_look(look, place)
        console.result(plan_step(place, look, output, speed, console, advice, allowed))


@app.command(
    short_help="Check a plan, a scene or a configuration.",
    help="Check a plan file again: limits and clearance of every segment that would be sent. "
    "Or check the queries and motions of a scene file against its expected results. With --q, "
    "list the closest pairs at a configuration in a scene, cell or task file. "
    "The plan of an arm without a unit describes its arm and needs no TASK.",
    epilog=examples(
        "a465 check plan.json scenes/task2.toml",
        "a465 check scenes/fixtures/capsule.toml --q 0,10,-80,0,-60,0",
    ),
)
def check(
    file: Annotated[
        Path, Argument(help="Plan file, or scene file such as scenes/fixtures/capsule.toml.", metavar="FILE")
    ],
    task: Annotated[
        Path | None,
        Argument(
            help="Task or cell file of the plan; default: found near it. None for an arm without a unit.",
            metavar="TASK",
        ),
    ] = None,
    q: Annotated[
        str | None, Option(help="J1 to J6 in deg, as in --q=-60,-40,-80,0,-60,0.", metavar="Q")
    ] = None,
    as_json: shared.Json = False,
) -> None:
    shared.refuse_swapped("check", file, task)
    with answering("checking", as_json) as console:
        from cell.commands.check import check_step

        report = check_step(file, task, q, console)
    console.result(report)
    if report.get("differing"):
        differences = shortened("; ".join(report["differences"]), MOST_MESSAGE // 2)
        refuse(shortened("; ".join([f"not as expected: {differences}", *report["doubts"]])))


@app.command(
    short_help="Write an HTML page that shows a plan or a log in 3D.",
    help="Write an HTML page that shows a plan in 3D, or the motion in a log over the planned one. "
    "The page opens in any browser, without a network.",
    epilog=examples(
        "a465 preview plan.json scenes/task2.toml -o plan.html", "a465 preview runs/task2-1/wire.jsonl"
    ),
)
def preview(
    file: Annotated[
        Path, Argument(help="Plan file, or log of a run such as runs/task2-1/wire.jsonl.", metavar="FILE")
    ],
    task: Annotated[
        Path | None,
        Argument(
            help="Task or cell file of the plan; default: found near it. None for a log, or an arm without a unit.",
            metavar="TASK",
        ),
    ] = None,
    output: shared.Output = None,
    look: Annotated[
        Path | None, Option(help="For a plan: detected boards, to show its predicted accuracy.")
    ] = None,
    image: shared.Photograph = None,
    as_json: shared.Json = False,
) -> None:
    shared.refuse_swapped("preview", file, task)
    with answering("drawing", as_json) as console:
        from cell.commands.preview import preview_file

        console.result(preview_file(file, task, output, console, look, image))


@app.command(
    short_help="Execute a plan in the simulated cell, or on the arm with --port.",
    help="Execute a plan file in the simulated cell, or on the arm with --port, if it matches the present cell. "
    "A plan without a unit, of another arm, is never sent. "
    "On a terminal: space pauses, + and - change the speed, q or Ctrl-C aborts.",
    epilog=examples("a465 execute plan.json scenes/task2.toml --speed 0.5"),
)
def execute(
    context: typer.Context,
    plan: shared.PlanFile,
    task: shared.PlannedTask = None,
    port: shared.Port = None,
    world: shared.WorldFile = None,
    images: shared.Images = None,
    camera: shared.Camera = None,
    speed: shared.LowerSpeed = None,
    resume: Annotated[
        bool, Option("--resume", help="After a stop: replan the rest of the task from where the arm is.")
    ] = False,
    budget: shared.Budget = None,
    give_up: shared.GiveUp = None,
    time_scale: shared.TimeScale = None,
    cell: shared.SimulatedAs = shared.CellKind.IDEAL,
    yes: Annotated[
        str | None, Option(help="With --port: the code shown in the plan's preview; default: ask.")
    ] = None,
    unseen: shared.UnseenRest = False,
    homed: shared.Homed = False,
    free: shared.Free = False,
    preload: shared.Preload = False,
    live: shared.LiveFlag = False,
    live_port: shared.LivePort = None,
    as_json: shared.Json = False,
) -> None:
    shared.refuse_swapped("execute", plan, task)
    if not resume:
        refuse_given(context, ("budget", "give_up"), "needs --resume: executing a plan needs no search")
        refuse_given(
            context, ("unseen",), "needs --resume: a whole plan is executed by the code of its preview"
        )
    if port is None:
        refuse_given(context, ("yes", "unseen", "homed", "free"), NO_PORT)
    else:
        refuse_given(context, ("cell",), WITH_PORT)
    with answering("starting", as_json) as console:
        from cell.commands.run import execute_plan, require_sendable, resume_plan
        from cell.session.budget import budget_of
        from cell.session.connection import WhichCell
        from cell.session.ports import choose_port
        from cell.task.approval import Approval
        from cell.task.free_cell import FreeCell

        if task is None:
            from cell.program.find_task import task_of_plan_file

            task = task_of_plan_file(plan)
            console.say(f"task: {task}")

    port = None if port is None else choose_port(port, task, console)
    contact = cell == shared.CellKind.MUJOCO
    where = WhichCell(port, world, images, camera, speed, time_scale, homed, preload, contact)
    confirm = None
    if port is not None:
        if yes is None:  # what is wrong is told before a person is asked
            require_sendable(plan, task, where)
        approval = Approval(plan, yes, console, resumes=resume, unseen=unseen)
        confirm = FreeCell(approval, port, homed or resume or free, console)
    with shared.watched(console, live, live_port) as watcher:
        if resume:
            allowed = budget_of(budget, give_up)
            result = resume_plan(plan, task, console, where, None, confirm, watcher, allowed)
        else:
            result = execute_plan(plan, task, console, where, None, confirm, watcher)
        finish(console, result)


app.registered_commands += manual.registered_commands + tools.registered_commands


def main() -> None:
    """Run the command line; turn an error, also of an option, into one line and its exit code."""
    with interruptible(ends=True), one_command():
        try:
            refuse_mistyped(sys.argv[1:])
            sys.exit(built_for(app, sys.argv[1:])(standalone_mode=False))
        except A465Error as error:
            fail(error)
        except typer.TyperException as error:
            fail_usage(error, app)
        except OSError as error:  # such as a name that is too long, wherever it is looked up first
            fail(InputError(f"{error.filename or 'system'}: {error.strerror or error}", file=error.filename))
