"""Homing: for the first time in a free cell, for nothing checks its way; or not at all, if the unit kept its positions.

With ``--homed`` a unit that is powered, was homed and says where it is stays as it is. What of that the unit can tell
is checked: no fault, counters that are not those of power-up and inside the limits, an arm that stands still. That its
counters are right it cannot tell.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from cell.asking import asked, at_terminal, typed
from cell.console import Console
from cell.holding import grip_of

if TYPE_CHECKING:
    from cell.taskrun import TaskRun

FREE, READY = "free", "ready"
_HERE = ("localhost", "127.0.0.1", "::1")


def may_be_real(port: str) -> bool:
    """Whether an arm may stand behind a port: any but a pseudo-terminal and this machine's own sockets."""
    if "://" in port:
        return urlsplit(port).hostname not in _HERE
    return not os.path.realpath(port).startswith("/dev/pts/")


def keep_home(run: TaskRun, jaws_too: bool = True) -> None:
    """Take an arm into use that was homed before; nothing moves.

    Args:
        run: of an open cell.
        jaws_too: the jaws are to be opened next, so nothing may be in them.

    Raises:
        ImpossibleError: a fault, counters as after power-up or outside the limits, or a cube in the jaws.
        ExecutionStopped: the arm does not stand still.
    """
    mars, cell = run.connection.mars, run.task.cell
    mars.initialise(home=False)
    counts = mars.settled_counts()
    width = cell.gripper.width(mars.jaws())
    if jaws_too and not grip_of(cell).why_not(width):
        raise ImpossibleError(
            f"the jaws stand {1e3 * width:.1f} mm apart, as on a cube, and would let go of it where the arm stands: "
            "take it out by hand, or go on with execute --resume",
            width=width,
        )
    degrees = ", ".join(f"{d:.1f}" for d in np.degrees(cell.unit.positions(counts)))
    run.console.step(
        f"not homed: --homed says that it was, since power-up, and the unit cannot tell; it is powered, without fault, "
        f"and at [{degrees}] deg by its counters: compare with the arm"
    )


def take_into_use(run: TaskRun) -> None:
    """Home the arm, unless it was and is; open the jaws.

    Raises:
        ImpossibleError: see `keep_home`.
        ExecutionStopped: something failed while homing, or the jaws do not open.
    """
    mars, cell, console = run.connection.mars, run.task.cell, run.console
    if run.homed_before:
        keep_home(run)
    else:
        console.step("homing: the controller moves every axis, nothing checks its way; then the jaws open")
        with console.doing("homing"):
            mars.initialise(home=True, soft_home=False)  # the way from the marks is planned like any other
    mars.set_registers(cell.speed_registers, cell.acceleration_registers)
    if mars.gripper(0.0).stalled:
        where = "where it was" if run.homed_before else "at its homing marks"
        raise ExecutionStopped(f"the jaws do not open: something blocks them; the arm stands {where}")
    console.step("jaws open" if run.homed_before else "homed, jaws open")


def before_homing(
    confirm: Callable[..., None], port: str, kept: bool, free: bool, console: Console
) -> Callable[..., None]:
    """An approval that asks for a free cell too, unless nothing is homed."""
    return confirm if kept else FreeCell(confirm, port, free, console)


class FreeCell:
    """Asks whether the cell is free before a real arm homes, and for the boards afterwards; wraps another approval.

    Args:
        confirm: asked first.
        port: of the arm.
        said: by --free: whatever homing may reach is away; boards are where they should be.
        console: where it is told and asked.
        answer: gives a line that was typed, None if there is nobody to type; default: the terminal.
    """

    def __init__(
        self,
        confirm: Callable[..., None],
        port: str,
        said: bool,
        console: Console,
        answer: Callable[[], str | None] | None = None,
    ) -> None:
        self.confirm, self.port, self.said = confirm, port, said
        self.console, self._answer = console, answer

    def __call__(self, run: TaskRun, *plan: Any) -> None:
        """Go on only if a person says so.

        Raises:
            InputError: nobody did; nothing moved.
        """
        if self.said or not may_be_real(self.port):
            self.confirm(run, *plan)
            return
        if self._answer is None and not at_terminal():
            raise InputError(
                "nobody is there to say that the cell is free for homing, whose way nothing checks: give --free, or "
                "--homed if the unit was homed since it was switched on",
                option="--free",
            )
        self.confirm(run, *plan)
        self._ask(
            "homing goes its own way: take everything out of the arm's reach, boards too; then type "
            f"{FREE} (if the unit was homed since it was switched on, end this and give --homed):",
            FREE,
        )
        run.after_homing = lambda: self._ask(
            f"the arm is homed and at q_start: put boards and cubes in place, leave the cage, and type {READY}:",
            READY,
        )

    def _ask(self, question: str, wanted: str) -> None:
        if not asked(
            self.console, question, wanted, lambda word: word.lower() == wanted, self._answer or typed
        ):
            raise InputError(f"{wanted!r} was not typed; nothing more moves", option="--free")
