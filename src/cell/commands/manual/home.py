"""``a465 home``: home the arm, open the jaws, and go to q_start."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arm.errors import ExecutionStopped, ImpossibleError
from cell.commands.manual.session import (
    FREE,
    arrive,
    beside,
    manual_speed,
    require_consent,
    require_person,
)
from cell.config.calibration_state import calibration_lines
from cell.console import Console
from cell.files.task import read_place
from cell.session.homed import may_be_real, which_arm
from cell.session.keyboard import ABORT_HELP
from cell.session.ports import choose_port
from cell.task.approval import ABOUT_HOMING
from cell.task.run import TaskRun

QUESTION = (
    "homing has no collision checks: remove everything from the arm's reach, boards too, and what the jaws hold; then "
    "type free:"
)


def home_step(
    place: Path, port: str | None, speed: float | None, free: bool, console: Console
) -> dict[str, Any]:
    """Home the arm on a port, open its jaws, and take it to q_start by a certified motion around the zone for boards.

    Args:
        place: cell or task file.
        port: of the controller; see `cell.session.ports.choose_port`.
        speed: of the motion to q_start; homing has the unit's own.
        free: the command line states that the arm can home freely.
        console: output.

    Raises:
        InputError: a file, value or port is wrong, or nobody confirmed that the cell is clear; nothing moved.
        ImpossibleError: the arm may not move.
        ExecutionStopped: motion stopped, or no certified motion leads from the marks to q_start; the state is in the
            error's data.
    """
    task = read_place(place)
    port = choose_port(port, place, console)
    said, low = free or not may_be_real(port), manual_speed(task.cell, speed)
    require_person(said, FREE, "that the cell is clear for homing, which has no collision checks", port)

    def ask(run: TaskRun) -> None:
        for line in (
            f"this moves {which_arm(port)}, {task.cell.unit.name}",
            *calibration_lines(task.cell, camera=False),
            ABOUT_HOMING,
        ):
            console.say(line)
        require_consent(said, FREE, console, QUESTION, "free")

    with beside(task, port, console, "home", low, ask, False, ABORT_HELP) as run:
        run.initialise_arm()
        try:
            run.go_to_start(None)
        except ImpossibleError as error:  # axes have moved, so this is no refusal
            why = f"homed, and the arm stands at its marks: no certified motion to q_start: {error}"
            raise ExecutionStopped(why, **error.data) from error
        return arrive(run, run.report())
