"""An open cell for a command beside the arm: without a camera, at a low speed, and not before a person has agreed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import ImpossibleError, InputError
from arm.plan_file import Plan
from arm.robot.jaws import after_closing
from arm.robot.model import Robot
from arm.se3 import Array
from cell.commands.run import opened
from cell.config.camera_keys import OF_CELL
from cell.config.cell import Cell
from cell.console import Console
from cell.files.observation import read_observation
from cell.files.task import Task
from cell.scene.build import build_scene, unseen_scene
from cell.session.connection import WhichCell
from cell.session.dialogue import at_terminal, require_word, typed
from cell.session.grasp_monitor import grip_fault
from cell.session.keyboard import HELP
from cell.session.ports import choose_port
from cell.session.speed import planning_speed
from cell.task.approval import Approval
from cell.task.planning import plan_motion, require_above_table
from cell.task.run import TaskRun
from driver.execution.control import Control
from driver.execution.rest import wait_settled
from driver.line.port import require_there
from driver.mars.gripper import read_jaws
from plan.scene import Scene

SPEED = 0.2  # of what the registers allow, unless the cell file has less
OPEN_WITHIN = 0.001  # m: jaws that are this close to open are open
UNSEEN, FREE, SUPPORTED = "--unseen", "--free", "--supported"


def manual_speed(cell: Cell, asked: float | None) -> float:
    """The speed of a command beside the arm: the requested one, or a low one.

    Raises:
        InputError: it is not from 0.01 to 1.
    """
    return planning_speed(cell, min(SPEED, cell.speed) if asked is None else asked)


def require_person(said: bool, option: str, what: str, port: str | None) -> None:
    """Refuse at once where nobody can be asked.

    Args:
        said: whether `option` answers in advance.
        option: of the command line.
        what: that has to be confirmed.
        port: of the command line, if it names one.

    Raises:
        InputError: there is no terminal, or no such port.
    """
    if said or at_terminal():
        return
    if port not in (None, OF_CELL):  # a wrong port is told before a person gives the option
        require_there(port)
    raise InputError(f"no terminal to confirm {what}: give {option}", option=option)


def require_consent(said: bool, option: str, console: Console, question: str, word: str) -> None:
    """Ask a person to type a word, unless the command line has the option that answers in advance.

    Raises:
        InputError: the word was not typed; nothing moved.
    """
    if not said:
        require_word(console, question, word, typed, "nothing moved", option)


@contextmanager
def beside(
    task: Task,
    port: str | None,
    console: Console,
    verb: str,
    speed: float,
    confirm: Callable[[TaskRun], None],
    homed: bool = True,
    keys: str | None = HELP,
    look: Path | None = None,
) -> Iterator[TaskRun]:
    """Open the cell on a port without a camera, with a run folder named after the verb; see `cell.commands.run.opened`.

    Args:
        task: with the cell.
        port: of the controller; see `cell.session.ports.choose_port`.
        speed: see `manual_speed`.
        confirm: asks the person; until it returns, the unit gets queries only.
        homed: whether the unit must have been homed since it was switched on.
        keys: what they do, see `cell.commands.run.opened`.
        look: detected boards, which are read before the port is opened, so that a wrong file is told first.
    """
    if look is not None:
        read_observation(look, task.cell)
    port = choose_port(port, task.cell.file, console)
    where = WhichCell(port, speed=speed, homed=homed, blind=True)
    with opened(task, console, where, speed, None, Control(), confirm, name=verb, keys=keys) as run:
        yield run


def q_now(run: TaskRun) -> Array:
    """Configuration of the arm at rest by its counters (6,), rad; by queries alone.

    Raises:
        ExecutionStopped: it moves, or does not answer.
    """
    mars = run.connection.mars
    return run.task.cell.unit.positions(wait_settled(mars.clock, mars.link.wait, mars.counters))


def jaws_width(run: TaskRun) -> float | None:
    """Distance of the resting jaws, m, by queries alone; None if the arm has none."""
    cell, mars = run.task.cell, run.connection.mars
    return cell.gripper.width(read_jaws(mars.link, cell.unit.gripper)) if cell.has_jaws else None


def holds_cube(cell: Cell, width: float | None) -> bool:
    """Whether jaws `width` m apart may hold a cube."""
    return width is not None and not grip_fault(cell, width)


def scene_now(run: TaskRun, look: Path | None) -> Scene:
    """What surrounds the arm, with jaws as they are.

    Args:
        run: on an open cell.
        look: detected boards, which stand there still; None: the whole zone for boards counts as occupied.

    Raises:
        InputError: the look is wrong.
        ImpossibleError: the jaws may hold a cube, whose pose in them is not known.
    """
    cell, width = run.task.cell, jaws_width(run)
    if holds_cube(cell, width):
        raise ImpossibleError(
            f"the jaws are {1e3 * (width or 0.0):.1f} mm apart, as on a cube, which this command does not know: go on "
            "with execute --resume, or take the cube out (a465 gripper open)",
            width=width,
        )
    robot = cell.robot() if width is None or _is_open(cell, width) else _with_unknown_jaws(run, width)
    if look is None:
        around = unseen_scene(cell)
    else:
        seen = read_observation(look, cell)
        require_above_table(run.task, seen)
        around = build_scene(cell, seen)
    return replace(around, robot_open=robot, robot_holding=robot)


def _is_open(cell: Cell, width: float) -> bool:
    return width >= cell.gripper.opening - OPEN_WITHIN


def _with_unknown_jaws(run: TaskRun, width: float) -> Robot:
    run.console.step(
        f"the jaws are {1e3 * width:.1f} mm apart: planned for any opening; what they may hold is not known"
    )
    return after_closing(run.task.cell.robot())


def plan_to(run: TaskRun, q: Array, look: Path | None) -> Plan | None:
    """Plan the certified motion from where the arm is to a configuration (6,), rad; None if it is there.

    Raises:
        InputError: the look is wrong.
        ImpossibleError: there is no such motion; without a look, because the zone for boards counts as occupied.
    """
    with explaining_zone(run, look), run.console.doing("planning"):
        return plan_motion(run.task, scene_now(run, look), q_now(run), q, run.speed)


@contextmanager
def explaining_zone(run: TaskRun, look: Path | None) -> Iterator[None]:
    """Add what would help: a look, if the zone for boards is too near; else steps away, if the arm is too near now."""
    try:
        yield
    except ImpossibleError as error:
        if look is None and run.task.cell.zone.name in error.data.get("pair", ()):
            help = (
                "the zone for boards counts as occupied; with --look FILE only the boards that were seen do"
            )
        elif error.data.get("end") == "from":
            help = "the steps of a465 jog lead the two apart"
        else:
            raise
        raise ImpossibleError(f"{error}; {help}", **error.data) from error


def require_seen(run: TaskRun, plan: Plan, unseen: bool) -> None:
    """Write a plan and its preview to the run folder; return once a person has typed the code of the preview.

    Args:
        run: on an open cell.
        plan: from where the arm is.
        unseen: whether the command line has --unseen; then nothing is asked.

    Raises:
        InputError: the code was not typed; nothing moved.
    """
    run.keep(plan, "plan")
    file = run.folder / "plan.json"
    run.console.step(f"preview: {run.folder / 'preview.html'}")
    Approval(file, plan.code if unseen else None, run.console)(run, plan)


def arrive(run: TaskRun, report: dict[str, Any]) -> dict[str, Any]:
    """Add where the arm is to a report, and print it."""
    q_deg = [round(float(d), 3) + 0.0 for d in np.degrees(run.q_now())]
    run.console.say(f"the arm is at rest at [{', '.join(f'{d:.2f}' for d in q_deg)}] deg")
    return {**report, "q_deg": q_deg}
