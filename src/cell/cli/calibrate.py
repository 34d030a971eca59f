"""The commands under ``a465 calibrate``. Like `cell.cli.main`, this module imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from arm.errors import CalibrationRefused, InputError
from cell.cli import options as shared
from cell.cli.options import NO_PORT, answering, examples, refuse, refuse_given

if TYPE_CHECKING:
    from cell.console import Console

app = typer.Typer(
    name="calibrate",
    short_help="Calibrate the camera's lens and pose, and the arm.",
    help="Calibrate what the planner relies on: the camera's lens, its pose, and the arm's joint offsets and links.",
    rich_markup_mode=None,
    no_args_is_help=True,
)

_TARGET = "Target file; default: ChArUco 7 x 5, 30/22 mm, DICT_5X5_100."
_Report = Annotated[Path | None, Option(help="HTML report to write; default: beside the file of -o.")]
_OUTPUT = "File to write if the result is accepted: TOML, or JSON for a NAO."
_Output = Annotated[Path | None, Option("-o", "--output", help=_OUTPUT)]
_LIMIT = (
    "Largest accepted prediction error of held-out images; default 1, for a NAO 2. For hand-eye also of the tool, in "
    "place of the limits of the cell file."
)
_LimitMm = Annotated[float | None, Option(help=_LIMIT)]
_ENCODER = "Encoder resolution; default: estimated from the readings."
_EncoderStep = Annotated[float | None, Option(help=_ENCODER)]
_LIFT = (
    "For a target that lies flat: in this image it lies on a box of this height, in the others without --lift on the "
    "table. IMAGE=HEIGHT_MM+-STD_MM states its standard deviation; default 0.2. May be repeated."
)
_CAMERA = "With --live: camera, such as name:camera-crs93, video:0@1280x720 or video:clip.mp4."
_COLLECT = "Record DATA first, in the cell of this task file: simulated, or real with --port."
_HAND_EYE_DATA = (
    "Recorded images and joints (JSON, docs/hand-eye.md); with --collect default: as -o, .recorded.json."
)
_RECIPE = "Use the fixed poses of the course report instead of the most informative ones."
_WORK = "Nearest and farthest working distance from the camera; default: as in the views."
_LIVE = "Take the images now, with advice on where to hold the target, until the views suffice."
_REGION = "Part of the image that matters, px; default: all of it. `look` refuses boards outside."
_CELL = "Cell or task file to compare with, whose limits and zone decide; with --collect: that of TASK."
_OF_COLLECT = (  # options of hand-eye
    *("target", "poses", "recipe", "seed", "port", "world", "images", "camera", "speed", "time_scale"),
    *("unseen", "homed", "free", "folder", "apply"),
)


@app.command(
    name="camera",
    short_help="Calibrate a camera's lens from images of a target.",
    help="Fit a camera's lens to images of a ChArUco board or checkerboard and report its uncertainty and a verdict. "
    "A lens that is not accurate enough is refused (exit code 5), with the reason and what would help.",
    epilog=examples("a465 calibrate camera photographs -o camera.toml  # then open camera.html"),
)
def calibrate_lens(
    images: Annotated[Path, Argument(help="Folder of images of the target.", metavar="IMAGES")],
    target: Annotated[Path | None, Option(help=_TARGET)] = None,
    hold: Annotated[
        list[str] | None, Option(help="Fix k1, k2, p1, p2 or k3 at zero. May be repeated.")
    ] = None,
    work_mm: Annotated[tuple[float, float] | None, Option(help=_WORK)] = None,
    work_region: Annotated[
        tuple[float, float, float, float] | None, Option(metavar="LEFT TOP RIGHT BOTTOM", help=_REGION)
    ] = None,
    limit_mm: Annotated[
        float | None, Option(help="Largest accepted standard deviation at the work points; default 0.3.")
    ] = None,
    most_views: Annotated[
        int | None, Option(help="Largest number of views to fit; the others are held out. Default 40.")
    ] = None,
    lift: Annotated[list[str] | None, Option(metavar="IMAGE=HEIGHT_MM", help=_LIFT)] = None,
    live: Annotated[bool, Option("--live", help=_LIVE)] = False,
    camera: Annotated[str | None, Option(help=_CAMERA)] = None,
    simulated: Annotated[
        Path | None, Option(help="With --live: use the simulated camera of this task file.")
    ] = None,
    output: _Output = None,
    report: _Report = None,
    as_json: shared.Json = False,
) -> None:
    with answering("calibrating", as_json) as console:
        from cell.commands.calibration.camera import LensOptions, camera_step

        options = LensOptions(
            output, report, limit_mm, target, hold or (), work_mm, most_views, lift or (), work_region
        )
        result = camera_step(images, options, live, camera, simulated, console)
    _finish(result, output, console)


@app.command(
    name="hand-eye",
    short_help="Calibrate the camera's pose and the arm's joint offsets.",
    help="Estimate the pose of the fixed camera, the pose of the target in the gripper, and the arm's joint offsets "
    "(zeros) and link errors. "
    "A result that is not accurate enough is refused (exit code 5), with the reason and what would help. "
    "--collect records DATA first; the options from --target to --folder, and --apply, need it.",
    epilog=examples("a465 calibrate hand-eye recorded.json --collect scenes/task2.toml -o calibration.toml"),
)
def calibrate_hand_eye(
    context: typer.Context,
    data: Annotated[Path | None, Argument(help=_HAND_EYE_DATA, metavar="[DATA]")] = None,
    collect: Annotated[Path | None, Option(help=_COLLECT)] = None,
    target: Annotated[
        Path | None, Option(help="Target in the gripper; default: scenes/targets/hand.toml.")
    ] = None,
    poses: Annotated[int | None, Option(help="Number of poses; default 24, or 270 with --recipe.")] = None,
    recipe: Annotated[bool, Option("--recipe", help=_RECIPE)] = False,
    seed: Annotated[int | None, Option(help="Seed for choosing the poses.")] = None,
    port: shared.Port = None,
    world: shared.WorldFile = None,
    images: shared.Images = None,
    camera: shared.Camera = None,
    speed: shared.Speed = None,
    time_scale: shared.TimeScale = None,
    unseen: shared.Unseen = False,
    homed: shared.Homed = False,
    free: shared.Free = False,
    folder: Annotated[Path | None, Option(help="Folder for plans and the wire log.")] = None,
    output: _Output = None,
    apply: Annotated[
        bool, Option("--apply", help="Name the file of -o in the cell file, as its calibration.")
    ] = False,
    cell: Annotated[Path | None, Option(help=_CELL)] = None,
    report: _Report = None,
    limit_mm: _LimitMm = None,
    encoder_step_deg: _EncoderStep = None,
    as_json: shared.Json = False,
) -> None:
    if data is None:
        if collect is None or output is None:
            rule = (
                "DATA is missing: give the recording, or --collect TASK -o FILE, which records it beside FILE"
            )
            raise InputError(rule, option="DATA")
        data = output.with_suffix(".recorded.json")
    if collect is None:
        refuse_given(context, _OF_COLLECT, "needs --collect TASK; without it, DATA is only read")
        with answering("calibrating", as_json) as console:
            from cell.commands.calibration.chain import ChainOptions, hand_eye_step

            options = ChainOptions(output, report, limit_mm, encoder_step_deg, cell)
            result = hand_eye_step(data, options, console)
        _finish(result, output, console)
        return
    refuse_given(context, ("cell",), "--collect TASK names the cell already")
    if port is None:
        refuse_given(context, ("unseen", "homed", "free"), NO_PORT)
    with answering("starting", as_json) as console:
        from arm.io.storage import data_file
        from cell.collect.collector import CollectOptions
        from cell.commands.calibration.chain import ChainOptions
        from cell.commands.calibration.collect import CollectFiles, collect_step
        from cell.session.connection import WhichCell
        from cell.session.ports import choose_port
        from cell.task.approval import Consent
        from cell.task.free_cell import FreeCell

    port = None if port is None else choose_port(port, collect, console)
    confirm = None if port is None else FreeCell(Consent(unseen, console), port, homed or free, console)
    hand = target or data_file("scenes/targets/hand.toml")
    files = CollectFiles(data, collect, hand, folder, apply)
    where = WhichCell(port, world, images, camera, speed, time_scale, homed)
    options = ChainOptions(output, report, limit_mm, encoder_step_deg)
    result = collect_step(files, CollectOptions.of(poses, seed, recipe), options, where, console, confirm)
    _finish(result, output, console)


@app.command(
    name="background",
    short_help="Record the background, to notice a camera that moves.",
    help="Record small features of the unmoving background: scratches, edges, marks on the table. Each look then "
    "measures on them how far the camera has moved since, corrects a small shift and refuses a large one. Do it right "
    "after the camera's pose was calibrated, with the arm at q_start and the table as free as possible.",
    epilog=examples("a465 calibrate background scenes/task2.toml -o background.npz --apply"),
)
def record_background(
    task: shared.TaskFile,
    images: shared.Images = None,
    camera: shared.Camera = None,
    world: shared.WorldFile = None,
    output: Annotated[Path, Option("-o", "--output", help="File to write (.npz).")] = Path("background.npz"),
    apply: Annotated[
        bool, Option("--apply", help="Enter the file of -o as background in the cell file.")
    ] = False,
    as_json: shared.Json = False,
) -> None:
    with answering("looking", as_json) as console:
        from cell.commands.calibration.background import background_step

        console.result(background_step(task, output, apply, console, images, camera, world))


@app.command(
    name="target",
    short_help="Write a calibration target to print at true size.",
    help="Write an SVG drawing of a calibration target, to print at true size: the target of a target file, or "
    "the ChArUco board that calibrate camera expects by default.",
    epilog=examples("a465 calibrate target scenes/targets/hand.toml -o hand.svg"),
)
def print_target(
    target: Annotated[Path | None, Argument(help=_TARGET, metavar="TARGET")] = None,
    output: Annotated[Path, Option("-o", "--output", help="SVG to write.")] = Path("target.svg"),
    as_json: shared.Json = False,
) -> None:
    with answering("drawing", as_json) as console:
        from cell.commands.calibration.print_target import target_print_step

        console.result(target_print_step(target, output, console))


@app.command(
    name="following",
    short_help="Estimate the arm's following error from logs of runs.",
    help="Compare the positions that were read at rest after each motion with those that were sent, and those in "
    "motion with the path. Prints the line for the cell file.",
    epilog=examples("a465 calibrate following runs/task2-1 runs/task2-2"),
)
def following(
    runs: Annotated[list[Path], Argument(help="Run folders, or their logs.", metavar="RUN...")],
    unit: Annotated[str | None, Option(help="crs93 or crs97; default: the unit named in the logs.")] = None,
    as_json: shared.Json = False,
) -> None:
    with answering("reading", as_json) as console:
        from cell.commands.calibration.following import following_step

        console.result(following_step(runs, unit, console))


@app.command(
    name="kinematic",
    short_help="Calibrate a NAO's camera and legs from its own images.",
    help="Estimate a NAO's camera, joint offsets, joint compliance and backlash from images of boards on its soles. "
    "A result that is not accurate enough is refused (exit code 5), with the reason and what would help.",
    epilog=examples("a465 calibrate kinematic recorded.json -o nao.json"),
)
def calibrate_kinematic(
    data: Annotated[Path, Argument(help="Recorded images and joints (JSON, docs/nao.md).", metavar="DATA")],
    output: _Output = None,
    report: _Report = None,
    limit_mm: _LimitMm = None,
    encoder_step_deg: _EncoderStep = None,
    as_json: shared.Json = False,
) -> None:
    with answering("calibrating", as_json) as console:
        from cell.commands.calibration.chain import ChainOptions, kinematic_step

        result = kinematic_step(data, ChainOptions(output, report, limit_mm, encoder_step_deg), console)
    _finish(result, output, console)


def _finish(result: dict[str, Any], output: Path | None, console: Console) -> None:
    """Print the result; exit with the code of a refused calibration if it is one."""
    console.result(result)
    if result["reasons"]:
        not_written = f"; {output} was not written" if output is not None else ""
        refuse(f"refused: {'; '.join(result['reasons'])}{not_written}", CalibrationRefused.exit_code)
