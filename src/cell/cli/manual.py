"""Commands for a person beside the arm. Like `cell.cli.main`, this module imports nothing heavy."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from arm.errors import InputError
from cell.cli import options as shared
from cell.cli.options import answering, examples
from cell.console import Console

manual = typer.Typer()  # `cell.cli.main` registers these commands
_PORT = (
    "Port of the controller, such as /dev/mars or socket://...; default: A465_PORT, or port of the cell file."
)


def _no_cell(port: str | None) -> str | None:
    if port is not None and port.endswith(".toml"):
        why = f"{port}: a file is where the port belongs; the cell or task file comes before the port"
        raise InputError(why, argument=port)
    return port


_BEFORE = {"gripper": "gripper ACTION", "teach": "teach LIST"}


def _no_port(context: typer.Context, place: Path) -> Path:
    """Refuse a port where the cell file belongs. `Path` has made one slash of the two of ``socket://``."""
    name, verb = str(place).replace("socket:/", "socket://"), context.info_name or ""
    is_port = place.suffix != ".toml" and (name.startswith(("/dev/", "socket://")) or place.is_char_device())
    if is_port and any(one.name == "port" for one in context.command.params):
        first = str(context.params.get("action", ""))
        if first.endswith(".toml"):
            right = f"a465 gripper open|close|WIDTH {first} {name}"
            why = f"{first}: is a file; the action comes first, then the cell, then the port: {right}"
            raise InputError(why, argument=first)
        words = f"a465 {_BEFORE.get(verb, verb)} CELL {name}"
        why = f"{name}: is a port; the cell or task file is missing before it: {words}"
        raise InputError(why, argument=name)
    return place


_Port = Annotated[str | None, Argument(help=_PORT, metavar="[PORT]", show_default=False, callback=_no_cell)]
_PORT_AND_CELL = f"{_PORT} And the cell or task file, before or after it."
_PortAndCell = Annotated[
    list[str] | None, Argument(help=_PORT_AND_CELL, metavar="[PORT] [CELL]", show_default=False)
]
_CELL = "Cell or task file: the unit, its calibration and the tool; default: the unit by its gripper's axis."
_CELL_OR_TASK = "Cell or task file, such as scenes/cell.toml."
_Place = Annotated[Path, Argument(help=_CELL_OR_TASK, metavar="CELL", callback=_no_port)]
_SPEED = "Fraction of what the speed registers allow, 0.01 to 1; default: 0.2, or motion.speed of the cell if less."
_Speed = Annotated[float | None, Option(help=_SPEED)]
_LOOK = "Boards that a465 look has seen and that stand there still; default: the whole zone for boards is occupied."
_Look = Annotated[Path | None, Option(help=_LOOK)]
_UNSEEN = "Do not ask before the arm moves."
_Unseen = Annotated[bool, Option("--unseen", help=_UNSEEN)]
_FREE = "Do not ask before homing. You state that the arm can home freely."
_SUPPORTED = "Do not ask. You state that the arm is supported, or may sink where it stands."
_Cell = Annotated[Path | None, Option("--cell", help=_CELL, metavar="CELL")]


@manual.command(
    short_help="Tell where the arm is and what has the port; nothing moves.",
    help="Tell where the arm is, its power and errors, and which a465 has the port since when. Only queries are sent; "
    "while another a465 has the port, its log is read instead.",
    epilog=examples("a465 status /dev/mars --cell scenes/cell.toml"),
)
def status(where: _PortAndCell = None, cell: _Cell = None, as_json: shared.Json = False) -> None:
    console = Console(as_json)
    from cell.commands.manual.status import status_step
    from cell.session.ports import port_and_place

    console.result(status_step(port_and_place(where or (), cell), console))


@manual.command(
    short_help="Record how an unknown unit answers; nothing moves.",
    help="Ask a unit what can be asked (version, states, axes, registers, echo, counts at rest), keep every byte with "
    "its time in a file for the maintainers, and compare it with what a465 assumes. Nothing moves; only the echo is "
    "set. The exit code is 3 unless everything agrees.",
    epilog=examples("a465 record /dev/mars -o unit.json", "a465 record --compare unit.json"),
)
def record(
    context: typer.Context,
    where: _PortAndCell = None,
    output: Annotated[
        Path | None, Option("-o", "--output", help="New file to write.", metavar="FILE")
    ] = None,
    seconds: Annotated[float, Option(help="How long to read the counts at rest, s.")] = 60.0,
    compare: Annotated[
        Path | None, Option(help="Compare this recording again; no port is opened.", metavar="FILE")
    ] = None,
    as_json: shared.Json = False,
) -> None:
    console = Console(as_json)
    if compare is None and output is None:
        raise InputError("record: give -o FILE, the file to write, or --compare FILE", option="-o")
    if compare is not None:
        shared.refuse_given(context, ("output", "seconds"), "cannot be combined with --compare")
        if where:
            raise InputError(f"{where[0]}: --compare opens no port; leave it out", port=where[0])
    from cell.commands.manual.record import compare_step, record_step
    from cell.session.ports import port_and_place

    if output is not None:
        report = record_step(port_and_place(where or ()), output, seconds, console)
    elif compare is not None:
        report = compare_step(compare, console)
    console.result(report)
    if report["differing"] or report["not_known"]:
        found = [("differs", report["differing"]), ("not known", report["not_known"])]
        shared.refuse("; ".join(f"{what}: {', '.join(names)}" for what, names in found if names))


@manual.command(
    short_help="Stop the arm at once, whatever has the port.",
    help="Stop the arm at once: STOP is sent without a question. If another a465 has the port, it is interrupted as by "
    "Ctrl-C, and ends. The arm stays under power. The emergency stop is the button, not this command.",
    epilog=examples("a465 stop /dev/mars"),
)
def stop(
    where: _PortAndCell = None,
    named: Annotated[
        list[str] | None, Option("--port", "--cell", hidden=True)
    ] = None,  # as other verbs have them
    as_json: shared.Json = False,
) -> None:
    console = Console(as_json)
    from cell.commands.manual.stop import stop_step
    from cell.session.ports import port_and_place

    console.result(stop_step(port_and_place([*(where or ()), *(named or ())]), console))


@manual.command(
    short_help="Home the arm, open the jaws, and go to q_start.",
    help="Home the arm, open the jaws, and go to q_start. Homing moves every axis without collision checks, so a real "
    "arm asks for a clear cell first. The motion to q_start is certified.",
    epilog=examples("a465 home scenes/cell.toml /dev/mars"),
)
def home(
    place: _Place,
    port: _Port = None,
    speed: _Speed = None,
    free: Annotated[bool, Option("--free", help=_FREE)] = False,
    as_json: shared.Json = False,
) -> None:
    with answering("starting", as_json) as console:
        from cell.commands.manual.home import home_step

    console.result(home_step(place, port, speed, free, console))


@manual.command(
    short_help="Go to q_start from where the arm is, by a certified motion.",
    help="Plan and certify the motion from where the arm is to q_start, write its preview, ask for the code that the "
    "preview shows, and execute it. The unit must have been homed since it was switched on.",
    epilog=examples(
        "a465 park scenes/cell.toml /dev/mars", "a465 park scenes/task2.toml /dev/mars --look look.json"
    ),
)
def park(
    place: _Place,
    port: _Port = None,
    look: _Look = None,
    speed: _Speed = None,
    unseen: _Unseen = False,
    as_json: shared.Json = False,
) -> None:
    with answering("starting", as_json) as console:
        from cell.commands.manual.park import park_step

    console.result(park_step(place, port, look, speed, unseen, console))


@manual.command(
    short_help="Go to joint angles, a tool position or a taught pose, certified.",
    help="Plan and certify a motion from where the arm is, write its preview, ask for the code that the preview shows, "
    "and execute it. Give one goal; a tool position keeps the tool's orientation. The unit must have been homed since "
    "it was switched on.",
    epilog=examples(
        "a465 move scenes/cell.toml /dev/mars --turn=10,0,0,0,0,0",
        "a465 move scenes/cell.toml /dev/mars --by=0,0,50 --line",
        'a465 move scenes/cell.toml /dev/mars --list poses.json --name "above the tray"',
    ),
)
def move(
    place: _Place,
    port: _Port = None,
    q: Annotated[
        str | None, Option(help="J1 to J6 in deg, as in --q=-60,-40,-80,0,-60,0.", metavar="Q")
    ] = None,
    turn: Annotated[
        str | None, Option(help="Turn J1 to J6 by these angles in deg, from where they are.", metavar="Q")
    ] = None,
    to: Annotated[
        str | None, Option(help="Position of the tool in the base frame, mm: --to=420,0,300.", metavar="XYZ")
    ] = None,
    by: Annotated[
        str | None, Option(help="Shift the tool along the axes of the base frame, mm.", metavar="XYZ")
    ] = None,
    along: Annotated[str | None, Option(help="Shift the tool along its own axes, mm.", metavar="XYZ")] = None,
    list_: Annotated[
        Path | None, Option("--list", help="List of poses, as of a465 teach; needs --name.", metavar="LIST")
    ] = None,
    name: Annotated[str | None, Option(help="Pose of the list.")] = None,
    line: Annotated[bool, Option("--line", help="Lead the tool on a straight line to its position.")] = False,
    look: _Look = None,
    speed: _Speed = None,
    unseen: _Unseen = False,
    as_json: shared.Json = False,
) -> None:
    with answering("starting", as_json) as console:
        from cell.commands.manual.move import move_step, read_goal

        goal = read_goal({"q": q, "turn": turn, "to": to, "by": by, "along": along}, list_, name, line)
    console.result(move_step(goal, place, port, look, speed, unseen, console))


@manual.command(
    short_help="Move the arm by keys, one small certified step each.",
    help="Move the arm by keys of the terminal: a press moves a joint or the tool by one step, and a held key goes on. "
    "Each step is certified before it is sent, and the arm is at rest 0.4 s after the last key. It asks for the arm's "
    "name once; the unit must have been homed since it was switched on. Esc stops, q ends.",
    epilog=examples("a465 jog scenes/cell.toml /dev/mars", "a465 jog scenes/cell.toml --deg 0.05 --mm 0.2"),
)
def jog(
    place: _Place,
    port: _Port = None,
    look: _Look = None,
    deg: Annotated[float, Option(help="Step of a joint, 0.01 to 1 deg.")] = 0.1,
    mm: Annotated[float, Option(help="Step of the tool, 0.05 to 5 mm.")] = 0.5,
    as_json: shared.Json = False,
) -> None:
    with answering("starting", as_json) as console:
        from cell.commands.jog.command import jog_step

    console.result(jog_step(place, port, look, deg, mm, console))


@manual.command(
    short_help="Open or close the jaws, or bring them to a width.",
    help="Open or close the jaws, or bring them to a width, where the arm stands. No joint is commanded to move. It "
    "asks first; the unit must have been homed since it was switched on.",
    epilog=examples(
        "a465 gripper open scenes/cell.toml /dev/mars", "a465 gripper 45 scenes/cell.toml /dev/mars"
    ),
)
def gripper(
    action: Annotated[str, Argument(help="open, close, or a width in mm.", metavar="open|close|WIDTH")],
    place: _Place,
    port: _Port = None,
    unseen: _Unseen = False,
    as_json: shared.Json = False,
) -> None:
    with answering("starting", as_json) as console:
        from cell.commands.manual.gripper import gripper_step

    console.result(gripper_step(action, place, port, unseen, console))


@manual.command(
    short_help="Switch the motors off; the arm may drop.",
    help="Switch the motors off: the brakes engage, and the arm may drop a little. It asks first. Positions are kept "
    "as long as the unit stays on, and the next motion switches the motors on again.",
    epilog=examples("a465 release /dev/mars"),
)
def release(
    where: _PortAndCell = None,
    supported: Annotated[bool, Option("--supported", help=_SUPPORTED)] = False,
    as_json: shared.Json = False,
) -> None:
    console = Console(as_json)
    from cell.commands.manual.release import release_step
    from cell.session.ports import port_and_place

    console.result(release_step(port_and_place(where or ()), supported, console))


@manual.command(
    short_help="Append the arm's present pose to a list of poses.",
    help="Append the arm's present pose to a list of poses in JSON, which a465 plan reads. The list is created "
    "if there is none. Nothing moves.",
    epilog=examples('a465 teach poses.json scenes/cell.toml /dev/mars --name "above the tray"'),
)
def teach(
    pose_list: Annotated[Path, Argument(help="List of poses: JSON.", metavar="LIST")],
    place: _Place,
    port: _Port = None,
    name: Annotated[str | None, Option(help='Name of the pose; default: the next "taught N".')] = None,
    as_json: shared.Json = False,
) -> None:
    console = Console(as_json)
    from cell.commands.manual.teach import teach_step

    console.result(teach_step(pose_list, place, port, name, console))


@manual.command(
    short_help="Take images with the cell's camera.",
    help="Take images with the cell's camera as it shows the cell now, and write them to a folder. Nothing moves.",
    epilog=examples("a465 snap scenes/cell.toml -o seen --camera name:camera-crs93"),
)
def snap(
    place: _Place,
    output: Annotated[
        Path, Option("-o", "--output", help="Folder; images that are there stay.", metavar="FOLDER")
    ],
    camera: shared.LookCamera = None,
    count: Annotated[
        int | None, Option(help="Number of images; default: as many as for a look.", metavar="N")
    ] = None,
    as_json: shared.Json = False,
) -> None:
    with answering("starting", as_json) as console:
        from cell.commands.manual.snap import snap_step

        console.result(snap_step(place, camera, output, count, console))
