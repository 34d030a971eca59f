"""``a465 park``: a certified motion from where the arm is to q_start."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arm.plan_file import Plan
from cell.commands.manual.session import (
    UNSEEN,
    arrive,
    beside,
    manual_speed,
    plan_to,
    require_person,
    require_seen,
)
from cell.console import Console
from cell.files.task import read_place
from cell.session.homed import home_or_check
from cell.task.run import TaskRun


def park_step(
    place: Path, port: str | None, look: Path | None, speed: float | None, unseen: bool, console: Console
) -> dict[str, Any]:
    """Plan a motion from where the arm is to q_start, write its preview, ask for its code, and execute it.

    Args:
        place: cell or task file.
        port: of the controller; see `cell.session.ports.choose_port`.
        look: detected boards, which stand there still; None: the whole zone for boards counts as occupied.
        speed: see `manual_speed`.
        unseen: whether the code of the preview is not asked for.
        console: output.

    Raises:
        InputError: a file, value or port is wrong, or the code was not typed; nothing moved.
        ImpossibleError: the unit was not homed, the arm may not move, or there is no certified motion; nothing moved.
        ExecutionStopped: motion stopped; the state is in the error's data.
    """
    task = read_place(place)
    low = manual_speed(task.cell, speed)
    require_person(unseen, UNSEEN, "that the arm may move", port)
    plans: list[Plan] = []

    def plan_and_ask(run: TaskRun) -> None:
        plan = plan_to(run, task.cell.q_start, look)
        if plan is not None:
            plans.append(plan)
            require_seen(run, plan, unseen)

    with beside(task, port, console, "park", low, plan_and_ask, look=look) as run:
        if not plans:
            console.step("the arm is at q_start already")
        for plan in plans:
            home_or_check(run.connection.mars, task.cell, console, True, jaws_too=False)
            run.homed = True
            run.follow_through(plan)
        return run.report() if not plans else arrive(run, run.report())
