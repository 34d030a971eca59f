"""``a465 gripper``: open or close the jaws, or bring them to a width, where the arm stands."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Any

from arm.errors import ExecutionStopped, InputError
from arm.robot.gripper import Gripper
from cell.commands.manual.session import (
    UNSEEN,
    beside,
    holds_cube,
    jaws_width,
    manual_speed,
    require_consent,
    require_person,
)
from cell.console import Console
from cell.files.task import read_place
from cell.session.homed import home_or_check, which_arm
from cell.session.keyboard import ABORT_HELP
from cell.task.run import TaskRun

OPEN, CLOSE = "open", "close"
_LEAST_MM = 1.0  # of a width that is not shut: jaws open at most 0.3 m, so that a width in m is less


def target_width(action: str, gripper: Gripper) -> float:
    """Return the width, m, that an action of the command line names.

    Raises:
        InputError: it is neither a word nor a width in the stroke of the gripper.
    """
    words = {OPEN: gripper.opening, CLOSE: gripper.shut}
    if action in words:
        return words[action]
    low, high = 1e3 * gripper.shut, 1e3 * gripper.opening
    try:
        width = float(action)
    except ValueError:
        width = math.nan
    if not low <= width <= high:
        why = f"gripper {action}: must be open, close, or a width from {low:g} to {high:g} mm"
        raise InputError(why, value=action)
    if 0.0 < width < _LEAST_MM:
        rule = f"must be 0, or {_LEAST_MM:g} mm or more"
        why = f"gripper {action}: {rule}; the number is mm: {1e3 * width:g} for {width:g} m"
        raise InputError(why, value=action)
    return 1e-3 * width


def gripper_step(
    action: str, place: Path, port: str | None, unseen: bool, console: Console
) -> dict[str, Any]:
    """Move the jaws once a person has agreed; no joint is commanded to move.

    Args:
        action: open, close, or a width in mm.
        place: cell or task file.
        port: of the controller; see `cell.session.ports.choose_port`.
        unseen: whether nothing is asked.
        console: output.

    Raises:
        InputError: a file, value or port is wrong, the cell has no jaws, or nobody agreed; nothing moved.
        ImpossibleError: the unit was not homed, or the arm may not move.
        ExecutionStopped: the jaws do not open, or a fault.
    """
    if action.endswith(".toml") or os.path.isfile(action):
        others = [str(place), *([port] if port is not None else [])]  # one of them is the action
        others.sort(key=lambda word: re.fullmatch(r"open|close|[\d.]+", word) is None)
        if re.fullmatch(r"open|close|[\d.]+", others[0]) is None:
            others.insert(0, "open|close|WIDTH")
        right = " ".join([others[0], action, *others[1:]])
        why = f"gripper {action}: is a file; the action comes first, then the cell: a465 gripper {right}"
        raise InputError(why, value=action)
    task = read_place(place)
    cell = task.cell
    target = target_width(action, cell.gripper)
    require_person(unseen, UNSEEN, "that the jaws may move", port)

    def ask(run: TaskRun) -> None:
        mars, width = run.connection.mars, jaws_width(run) or 0.0
        console.say(
            f"this moves the jaws of {which_arm(mars.link.url)}, {cell.unit.name}, from {1e3 * width + 0.0:.1f} to "
            f"{1e3 * target:.1f} mm: keep your fingers away"
        )
        if target > width and holds_cube(cell, width):
            console.say("THE JAWS ARE AT THE WIDTH OF A CUBE: what they hold drops where the arm stands")
        name = cell.unit.name
        require_consent(unseen, UNSEEN, console, f"type {name} to let them move:", name)

    with beside(task, port, console, "gripper", manual_speed(cell, None), ask, keys=ABORT_HELP) as run:
        mars = run.connection.mars
        home_or_check(mars, cell, console, True, jaws_too=False)
        run.homed = True
        before = jaws_width(run) or 0.0
        ended = mars.gripper(cell.gripper.fraction_closed(target))
        width = cell.gripper.width(ended.fraction_closed)
        words = f"the jaws are {1e3 * width + 0.0:.1f} mm apart"
        if ended.stalled and target > before:
            raise ExecutionStopped(f"{words} and do not open: something blocks them")
        console.step(f"{words}: something is between them" if ended.stalled else words)
        return {
            "jaws_mm": round(1e3 * width, 2) + 0.0,
            "target_mm": round(1e3 * target, 2),
            "stalled": ended.stalled,
            "folder": str(run.folder),
        }
