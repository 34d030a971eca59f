"""A free cell: a person says so before a real arm homes, and puts the boards in place afterwards."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from arm.errors import InputError
from cell.console import Console
from cell.session.dialogue import asked, at_terminal, typed
from cell.session.homed import may_be_real

if TYPE_CHECKING:
    from cell.task.run import TaskRun


FREE, READY = "free", "ready"


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
