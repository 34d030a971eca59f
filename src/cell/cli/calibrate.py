"""The verbs under ``a465 calibrate``. Like `cell.cli.main`, this module imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from arm.errors import CalibrationRefused

if TYPE_CHECKING:
    from cell.console import Console

app = typer.Typer(
    name="calibrate",
    short_help="Find the camera's lens and place, and the arm's errors.",
    help="Find out what the planner rests on: the camera's lens, its place, and the arm's own errors.",
    rich_markup_mode=None,
    no_args_is_help=True,
)


@app.command(
    name="camera",
    short_help="Find a camera's lens from photographs of a target.",
    help="Fit a camera's lens to photographs of a ChArUco board or checkerboard, with its uncertainty and a verdict. "
    "A lens that is not good enough is refused (exit code 5), with the reason and what would help.",
    epilog="Example: a465 calibrate camera photographs -o camera.toml; then open camera.html",
)
def calibrate_lens(
    images: Annotated[Path, typer.Argument(help="Folder of photographs of the target.", metavar="IMAGES")],
    target: Annotated[
        Path | None,
        typer.Option("--target", help="Target file; default: ChArUco 7 x 5, 30/22 mm, DICT_5X5_100."),
    ] = None,
    hold: Annotated[
        list[str] | None,
        typer.Option("--hold", help="Leave k1, k2, p1, p2 or k3 at zero. May be given again."),
    ] = None,
    work_mm: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--work-mm",
            help="Nearest and farthest distance of the work from the camera; default: the views'.",
        ),
    ] = None,
    limit_mm: Annotated[
        float | None,
        typer.Option(
            "--limit-mm", help="Largest standard deviation at the work points that is accepted; default 0.3."
        ),
    ] = None,
    most_views: Annotated[
        int | None, typer.Option("--most-views", help="More are held out; default 40.")
    ] = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Take the photographs now: say where to hold the target, until it is enough."
        ),
    ] = False,
    camera: Annotated[
        str | None, typer.Option("--camera", help="With --live: a Basler camera, such as name:camera-crs93.")
    ] = None,
    simulated: Annotated[
        Path | None, typer.Option("--simulated", help="With --live: a task whose simulated camera looks.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Camera file to write, if the lens is accepted.")
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="HTML report; default: beside the camera file.")
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print one JSON object on standard output, all else on standard error."),
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
    typer.Option(
        "--limit-mm", help="Largest error of predicted images that is accepted; default 1, of a NAO 2."
    ),
]
_STEP = Annotated[
    float | None,
    typer.Option("--encoder-step-deg", help="Step of the encoders; default: seen from their readings."),
]
_REPORT = Annotated[
    Path | None, typer.Option("--report", help="HTML report; default: beside the file that -o writes.")
]
_JSON = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on standard output, all else on standard error.")
]


@app.command(
    name="hand-eye",
    short_help="Find the camera's place and the arm's zeros and links.",
    help="Find where the fixed camera stands, how the target is held and what the arm's zeros (and links) are off by. "
    "What is not good enough is refused (exit code 5), with the reason and what would help.",
    epilog="Example: a465 calibrate hand-eye recorded.json --collect scenes/task2.toml -o calibration.toml",
)
def calibrate_hand_eye(
    data: Annotated[
        Path, typer.Argument(help="Recorded images and joints (JSON, docs/hand-eye.md).", metavar="DATA")
    ],
    collect: Annotated[
        Path | None,
        typer.Option(
            "--collect", help="Record DATA first, in the cell of this task: simulated, or real with --port."
        ),
    ] = None,
    target: Annotated[
        Path | None,
        typer.Option(
            "--target", help="With --collect: what the hand holds; default: scenes/targets/hand.toml."
        ),
    ] = None,
    poses: Annotated[
        int | None, typer.Option("--poses", help="With --collect: how many; default 24, with --recipe 270.")
    ] = None,
    recipe: Annotated[
        bool,
        typer.Option("--recipe", help="With --collect: the first report's poses, not the most telling ones."),
    ] = False,
    seed: Annotated[
        int | None, typer.Option("--seed", help="With --collect: of the choice of poses.")
    ] = None,
    port: Annotated[
        str | None, typer.Option("--port", help="With --collect: of the real controller.")
    ] = None,
    world: Annotated[
        Path | None, typer.Option("--world", help="With --collect: truth of the simulated cell.")
    ] = None,
    images: Annotated[
        Path | None, typer.Option("--images", help="With --port: folder that gets photographs.")
    ] = None,
    camera: Annotated[str | None, typer.Option("--camera", help="With --port: a Basler camera.")] = None,
    speed: Annotated[
        float | None,
        typer.Option(
            "--speed",
            help="With --collect: share of what the registers allow, 0.01 to 1; default: the cell's.",
        ),
    ] = None,
    time_scale: Annotated[
        float | None, typer.Option("--time-scale", help="With --collect: of the simulated cell.")
    ] = None,
    unseen: Annotated[
        bool,
        typer.Option(
            "--unseen", help="With --port: move by plans that nobody has seen; else it is asked for."
        ),
    ] = False,
    homed: Annotated[
        bool,
        typer.Option(
            "--homed",
            help="With --port: the unit was homed since power-up; it is checked, and not homed anew.",
        ),
    ] = False,
    free: Annotated[
        bool,
        typer.Option("--free", help="With --port: nothing stands where homing goes; else it is asked for."),
    ] = False,
    folder: Annotated[
        Path | None, typer.Option("--folder", help="With --collect: for plans and the wire log.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Calibration file to write, if it is accepted.")
    ] = None,
    apply: Annotated[
        bool, typer.Option("--apply", help="With --collect: let the cell file name the calibration file.")
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
        raise InputError(f"{name}: goes with --collect TASK; DATA is read as it is otherwise", option=name)


@app.command(
    name="target",
    short_help="Write a calibration target to print, true to size.",
    help="Write the drawing of a calibration target, to be printed at its true size: of a target file, or the ChArUco "
    "board that calibrate camera expects.",
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
    short_help="Find a NAO's camera and legs from its own images.",
    help="Find camera, joint offsets, springs and play of a NAO from images of the boards on its soles. "
    "What is not good enough is refused (exit code 5), with the reason and what would help.",
    epilog="Example: a465 calibrate kinematic recorded.json -o nao.json",
)
def calibrate_kinematic(
    data: Annotated[
        Path, typer.Argument(help="Recorded images and joints (JSON, docs/nao.md).", metavar="DATA")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Result to write (JSON), if it is accepted.")
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
