"""Arguments, options and exits that several commands share. An option with a value is named after its parameter."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from enum import StrEnum
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from arm.errors import ImpossibleError, InputError
from cell.console import Console, say_on_stderr

if TYPE_CHECKING:
    from cell.session.observer import RunObserver

TaskFile = Annotated[Path, Argument(help="Task file, such as scenes/task2.toml.", metavar="TASK")]
PlanFile = Annotated[Path, Argument(help="Plan file, as written by a465 plan.", metavar="PLAN")]
ProgramFile = Annotated[
    Path,
    Argument(help="Task or program file, such as scenes/task2.toml or scenes/hoop/b.toml.", metavar="TASK"),
]
PlannedTask = Annotated[
    Path | None,
    Argument(
        help="Task, program or cell file of the plan; default: the one near it that it was made for.",
        metavar="TASK",
    ),
]
LookFile = Annotated[Path, Option(help="File of detected boards, as written by a465 look.")]
_JSON = "Print one JSON object on standard output, the rest on standard error."
Json = Annotated[bool, Option("--json", help=_JSON)]
_FRACTION = (
    "Fraction of what the speed registers allow, 0.01 to 1; accelerations scale with its square. Default: "
)
Speed = Annotated[float | None, Option(help=f"{_FRACTION}motion.speed of the cell file.")]
LowerSpeed = Annotated[float | None, Option(help=f"{_FRACTION}the plan's speed, which it can only lower.")]
_WORLD = "Ground truth of the simulated cell; default: beside TASK, such as scenes/task2.world.toml."
WorldFile = Annotated[Path | None, Option(help=_WORLD)]
_PORT = "Serial port of the controller, such as /dev/mars or socket://..., or cell for A465_PORT or the cell file's."
Port = Annotated[str | None, Option(help=_PORT)]
Images = Annotated[Path | None, Option(help="Folder of images, in place of a camera.")]
SELECTORS = (
    "name:NAME, serial:NUMBER, ip:ADDRESS or class:CLASS (Basler), "
    "video:NUMBER, video:/dev/NAME, video:URL or video:FILE (others) or cell for the one in the cell file."
)
RECORDING = "video:FILE is a recording."
TRIED = (
    "Tried so far: pylon's emulation, and motion JPEG by HTTP and RTSP on one machine; no real Basler camera, no UVC "
    "device."
)
Camera = Annotated[str | None, Option(help=f"Camera: {SELECTORS} {TRIED}", metavar="SELECTOR")]
_RECORDED = f"Camera: {SELECTORS} {RECORDING} {TRIED}"
LookCamera = Annotated[str | None, Option(help=_RECORDED, metavar="SELECTOR")]
_SCALE = "Simulated cell only: at most this many emulated seconds per second; default: 10."
TimeScale = Annotated[float | None, Option(help=_SCALE)]


class CellKind(StrEnum):
    """Kinds of simulated cells."""

    IDEAL = "ideal"
    MUJOCO = "mujoco"


_CELL = (
    "Simulated cell: ideal grips and seats, or MuJoCo's contact physics "
    "(pip install 'a465[contact]'). Default: ideal."
)
SimulatedAs = Annotated[CellKind, Option("--cell", help=_CELL, show_default=False)]
Advice = Annotated[bool, Option(help="After a refusal, search for a change that would help.")]
_BUDGET = (
    "Search effort in nominal seconds; when it is spent, the best complete plan so far is used. Effort is counted, not "
    "timed, so the plan is repeatable."
)
Budget = Annotated[float | None, Option(help=_BUDGET, metavar="S")]
_GIVE_UP = "Wall time in s after which planning is refused. It never changes a plan."
GiveUp = Annotated[float | None, Option(help=_GIVE_UP, metavar="S")]
Output = Annotated[Path | None, Option("-o", "--output", help="File to write; an existing one is replaced.")]
PlanOutput = Annotated[Path, Option("-o", "--output", help="Plan file to write.")]
_PAGE = "HTML page to write: the plan in 3D, or if there is none, where and why it is refused."
RefusalPage = Annotated[Path | None, Option("--page", help=_PAGE)]
Photograph = Annotated[
    Path | None,
    Option("--image", help="Photograph by the cell's camera, to lay over what it sees.", metavar="FILE"),
]
LiveFlag = Annotated[bool, Option("--live", help="Serve a page on this machine that shows the run live.")]
LivePort = Annotated[int | None, Option(help="Port of the live view on 127.0.0.1; default: any free port.")]
_UNSEEN = "With --port: do not ask for the unit's name before executing plans that nobody has previewed."
Unseen = Annotated[bool, Option("--unseen", help=_UNSEEN)]
_REST = "With --resume: do not ask for the code of the plan whose rest is executed."
UnseenRest = Annotated[bool, Option("--unseen", help=_REST)]
_HOMED = (
    "With --port: do not home. You state that the unit was homed since power-up, which cannot be verified."
)
Homed = Annotated[bool, Option("--homed", help=_HOMED)]
_PRELOAD = (
    "For a noisy serial line: load each motion (its first 149 segments) into the unit and verify it before it begins. "
    "A damaged motion is sent again."
)
Preload = Annotated[bool, Option("--preload", help=_PRELOAD)]
_FREE = "With --port: home without asking. You state that the arm can home freely with the boards in place."
Free = Annotated[bool, Option("--free", help=_FREE)]
WITH_PORT = "cannot be combined with --port: it is for the simulated cell"
NO_PORT = "needs --port: the simulated cell asks for no confirmation"


def examples(*commands: str) -> str:
    """Return the end of a help text: commands to copy, wrapped as a shell continues a line."""
    lines = ["\b\nExamples:" if len(commands) > 1 else "\b\nExample:"]
    for command in commands:
        kept = re.sub(r"( -\S+) (?!-)", "\\1\xa0", command)  # an option stays with its value
        lines.append(" \\\n      ".join(wrap(kept, 72, break_on_hyphens=False, break_long_words=False)))
    return "\n  ".join(lines).replace("\xa0", " ")


@contextmanager
def answering(what: str, as_json: bool) -> Iterator[Console]:
    """Yield the console of a command, with a busy line while it works."""
    console = Console(as_json)
    with console.doing(what):
        yield console


@contextmanager
def pictured(
    page: Path | None, file: Path, look: Path | None, console: Console, plan: Path | None = None
) -> Iterator[None]:
    """Write a page of what comes out inside: of a refusal, or else of the plan, or of the place without one."""
    if page is None:
        yield
        return
    from cell.preview.refusal.page import refusal_shown

    with refusal_shown(page, file, look, plan):
        yield
    if plan is None:
        from cell.preview.of_place import view_step

        view_step(file, look, None, page, console)
    else:
        from cell.commands.preview import preview_file

        preview_file(plan, file, page, console)


def watched(console: Console, live: bool, port: int | None) -> AbstractContextManager[RunObserver | None]:
    """Return a live view if `live` or a port is given."""
    if not live and port is None:
        return nullcontext()
    from cell.live.view import live_view

    return live_view(console, port or 0)


def refuse_given(context: typer.Context, names: tuple[str, ...], rule: str) -> None:
    """Refuse options that do not apply.

    Args:
        context: context of the command.
        names: parameters of the command.
        rule: why they do not apply; follows the name of the option in the message.

    Raises:
        InputError: one of them is on the command line.
    """
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is not None and source.name == "COMMANDLINE":
            option = parameter.opts[-1]
            raise InputError(f"{option} {rule}", option=option)


def refuse_swapped(verb: str, plan: Path, task: Path | None) -> None:
    """Refuse a plan and its task in the wrong order.

    Args:
        verb: the command, for the message.
        plan: first argument: a plan, or what the command takes instead of one.
        task: second argument: the plan's task file, if any.

    Raises:
        InputError: `plan` is a task, cell or arm file, and `task` is JSON.
    """
    from arm.io.storage import begins_as_object
    from arm.io.toml_reader import read_toml

    keys: set[str] = set()
    with suppress(InputError):
        keys = set() if task is None or not begins_as_object(task) else set(read_toml(plan))
    if keys & {"task", "camera", "arm", "program"}:
        why = f"{plan} and {task} are swapped: the plan comes first, then its task; give a465 {verb} {task} {plan}"
        raise InputError(why, plan=str(task), task=str(plan))


def refuse(message: str, exit_code: int = ImpossibleError.exit_code) -> None:
    """Report why a command did not succeed, and exit, after its result has been printed."""
    say_on_stderr(f"a465: {message}")
    raise typer.Exit(exit_code)
