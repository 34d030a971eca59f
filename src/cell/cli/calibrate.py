"""The commands under ``a465 calibrate``. Like `cell.cli.main`, this module imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from arm.errors import CalibrationRefused

if TYPE_CHECKING:
    from cell.console import Console

app = typer.Typer(
    name="calibrate",
    short_help="Calibrate the camera's lens and pose, and the arm.",
    help="Calibrate what the planner relies on: the camera's lens, its pose, and the arm's joint offsets and links.",
    rich_markup_mode=None,
    no_args_is_help=True,
)


@app.command(
    name="camera",
    short_help="Calibrate a camera's lens from images of a target.",
    help="Fit a camera's lens to images of a ChArUco board or checkerboard and report its uncertainty and a verdict. "
    "A lens that is not accurate enough is refused (exit code 5), with the reason and what would help.",
    epilog="Example: a465 calibrate camera photographs -o camera.toml; then open camera.html",
)
def calibrate_lens(
    images: Annotated[Path, typer.Argument(help="Folder of images of the target.", metavar="IMAGES")],
    target: Annotated[
        Path | None,
        typer.Option("--target", help="Target file; default: ChArUco 7 x 5, 30/22 mm, DICT_5X5_100."),
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option("--hold", help="Fix k1, k2, p1, p2 or k3 at zero. May be repeated."),
    ] = None,
    work_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--work-mm",
            help="Nearest and farthest working distance from the camera; default: those of the views.",
        ),
    ] = None,
    limit_mm: Annotated[
        float | None,
        typer.Option(
            "--limit-mm", help="Largest accepted standard deviation at the work points; default 0.3."
        ),
    ] = None,
    most_views: Annotated[
        int | None, typer.Option("--most-views", help="Fit at most this many; hold out the rest. Default 40.")
    ] = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Take the images now, guided: where to hold the target, until the views suffice."
        ),
    ] = False,
    camera: Annotated[
        str | None, typer.Option("--camera", help="With --live: Basler camera, such as name:camera-crs93.")
    ] = None,
    simulated: Annotated[
        Path | None, typer.Option("--simulated", help="With --live: use this task's simulated camera.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Camera file to write if the lens is accepted.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="HTML report; default: beside the camera file.")
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print one JSON object on standard output, the rest on standard error."),
    ] = False,
) -> None:
    from cell.console import Console

    console = Console(as_json)
    with console.doing("calibrating"):
        from cell.commands.calibration.camera import LensOptions, camera_step

        options = LensOptions(target, tuple(hold or ()), work_mm, limit_mm, most_views, output, report)
        result = camera_step(images, options, live, camera, simulated, console)
    _finish(result, output, console)


_LIMIT = Annotated[
    float | None,
    typer.Option("--limit-mm", help="Largest accepted error of predicted images; default 1, for a NAO 2."),
]
_STEP = Annotated[
    float | None,
    typer.Option("--encoder-step-deg", help="Encoder resolution; default: estimated from the readings."),
]
_REPORT = Annotated[
    Path | None, typer.Option("--report", help="HTML report; default: beside the file that -o writes.")
]
_JSON = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output, the rest on standard error.")
]


@app.command(
    name="hand-eye",
    short_help="Calibrate the camera's pose and the arm's joint offsets.",
    help="Estimate the pose of the fixed camera, the pose of the target in the gripper, and the arm's joint offsets "
    "(zeros) and link errors. "
    "A result that is not accurate enough is refused (exit code 5), with the reason and what would help.",
    epilog="Example: a465 calibrate hand-eye recorded.json --collect scenes/task2.toml -o calibration.toml",
)
def calibrate_hand_eye(
    data: Annotated[
        Path, typer.Argument(help="Recorded images and joints (JSON, docs/hand-eye.md).", metavar="DATA")
    ],
    collect: Annotated[
        Path | None,
        typer.Option(
            "--collect",
            help="Record DATA first, in the cell of this task file: simulated, or real with --port.",
        ),
    ] = None,
    target: Annotated[
        Path | None,
        typer.Option(
            "--target",
            help="With --collect: target in the gripper; default: scenes/targets/hand.toml.",
        ),
    ] = None,
    poses: Annotated[
        int | None,
        typer.Option("--poses", help="With --collect: number of poses; default 24, with --recipe 270."),
    ] = None,
    recipe: Annotated[
        bool,
        typer.Option(
            "--recipe", help="With --collect: the fixed poses of the first report, not the most informative."
        ),
    ] = False,
    seed: Annotated[
        int | None, typer.Option("--seed", help="With --collect: seed for choosing the poses.")
    ] = None,
    port: Annotated[
        str | None, typer.Option("--port", help="With --collect: serial port of the real controller.")
    ] = None,
    world: Annotated[
        Path | None, typer.Option("--world", help="With --collect: ground truth of the simulated cell.")
    ] = None,
    images: Annotated[
        Path | None, typer.Option("--images", help="With --port: folder in which new images arrive.")
    ] = None,
    camera: Annotated[str | None, typer.Option("--camera", help="With --port: Basler camera.")] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            "--speed",
            help="With --collect: fraction of the speed registers, 0.01 to 1; default: the cell file's.",
        ),
    ] = None,
    time_scale: Annotated[
        float | None, typer.Option("--time-scale", help="With --collect: time scale of the simulated cell.")
    ] = None,
    unseen: Annotated[
        bool,
        typer.Option("--unseen", help="With --port: execute plans without preview and without asking."),
    ] = False,
    homed: Annotated[
        bool,
        typer.Option(
            "--homed",
            help="With --port: do not home; you state that the unit was homed since power-up.",
        ),
    ] = False,
    free: Annotated[
        bool,
        typer.Option("--free", help="With --port: home without asking; you state that the cell is clear."),
    ] = False,
    folder: Annotated[
        Path | None, typer.Option("--folder", help="With --collect: folder for plans and the wire log.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Calibration file to write if it is accepted.")
    ] = None,
    apply: Annotated[
        bool,
        typer.Option("--apply", help="With --collect: enter the calibration file in the cell file."),
    ] = False,
    report: _REPORT = None,
    limit_mm: _LIMIT = None,
    encoder_step_deg: _STEP = None,
    as_json: _JSON = False,
) -> None:
    from cell.console import Console

    console = Console(as_json)
    if collect is not None:
        from arm.io.storage import data_file
        from cell.collect.collector import CollectOptions
        from cell.commands.calibration.collect import CollectFiles, collect_step
        from cell.session.connection import WhichCell
        from cell.task.approval import Consent, require_a_port
        from cell.task.free_cell import before_homing

        require_a_port("--unseen", unseen, port)
        require_a_port("--homed", homed, port)
        require_a_port("--free", free, port)
        confirm = (
            None if port is None else before_homing(Consent(unseen, console), port, homed, free, console)
        )
        hand = target or data_file("scenes/targets/hand.toml")
        files = CollectFiles(data, collect, hand, output, report, apply, folder)
        where = WhichCell(port, world, images, camera, speed, time_scale, homed)
        options = CollectOptions.of(poses, seed, recipe)
        result = collect_step(files, options, limit_mm, where, console, encoder_step_deg, confirm)
    else:
        _only_with_collect(
            target=target,
            poses=poses,
            recipe=recipe or None,
            seed=seed,
            port=port,
            world=world,
            images=images,
            camera=camera,
            speed=speed,
            time_scale=time_scale,
            unseen=unseen or None,
            homed=homed or None,
            free=free or None,
            folder=folder,
            apply=apply or None,
        )
        with console.doing("calibrating"):
            from cell.commands.calibration.chain import hand_eye_step

            result = hand_eye_step(data, output, report, limit_mm, encoder_step_deg, console)
    _finish(result, output, console)


def _only_with_collect(**options: object) -> None:
    given = [name for name, value in options.items() if value is not None]
    if given:
        from arm.errors import InputError

        name = f"--{given[0].replace('_', '-')}"
        raise InputError(f"{name} needs --collect TASK; without it, DATA is only read", option=name)


@app.command(
    name="target",
    short_help="Write a calibration target to print at true size.",
    help="Write an SVG drawing of a calibration target, to be printed at true size: the target of a target file, or "
    "the ChArUco board that calibrate camera expects by default.",
    epilog="Example: a465 calibrate target scenes/targets/hand.toml -o hand.svg",
)
def print_target(
    target: Annotated[
        Path | None,
        typer.Argument(
            help="Target file; default: ChArUco 7 x 5, 30/22 mm, DICT_5X5_100.", metavar="[TARGET]"
        ),
    ] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="SVG to write.")] = Path("target.svg"),
    as_json: _JSON = False,
) -> None:
    from cell.console import Console

    console = Console(as_json)
    with console.doing("drawing"):
        from cell.commands.calibration.print_target import target_print_step

        result = target_print_step(target, output, console)
    console.result(result)


@app.command(
    name="kinematic",
    short_help="Calibrate a NAO's camera and legs from its own images.",
    help="Estimate camera, joint offsets, joint compliance and backlash of a NAO from images of boards on its soles. "
    "A result that is not accurate enough is refused (exit code 5), with the reason and what would help.",
    epilog="Example: a465 calibrate kinematic recorded.json -o nao.json",
)
def calibrate_kinematic(
    data: Annotated[
        Path, typer.Argument(help="Recorded images and joints (JSON, docs/nao.md).", metavar="DATA")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Result to write (JSON) if it is accepted.")
    ] = None,
    report: _REPORT = None,
    limit_mm: _LIMIT = None,
    encoder_step_deg: _STEP = None,
    as_json: _JSON = False,
) -> None:
    from cell.console import Console

    console = Console(as_json)
    with console.doing("calibrating"):
        from cell.commands.calibration.chain import kinematic_step

        result = kinematic_step(data, output, report, limit_mm, encoder_step_deg, console)
    _finish(result, output, console)


def _finish(result: dict[str, Any], output: Path | None, console: Console) -> None:
    from cell.console import say_on_stderr

    console.result(result)
    if result["reasons"]:
        not_written = f"; {output} was not written" if output is not None else ""
        say_on_stderr(f"a465: refused: {'; '.join(result['reasons'])}{not_written}")
        raise typer.Exit(CalibrationRefused.exit_code)
