"""Ask a person to clear the cell before a real arm homes, and to put the boards back afterwards."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from arm.errors import InputError
from cell.console import Console
from cell.session.dialogue import at_terminal, require_word, typed
from cell.session.homed import may_be_real

if TYPE_CHECKING:
    from cell.task.run import TaskRun


FREE, READY = "free", "ready"


@dataclass(eq=False)
class FreeCell:
    """Wrap an approval: also ask for a clear cell before a real arm homes, and for the boards afterwards.

    Attributes:
        confirm: the approval that is asked first.
        port: of the arm.
        said: whether the command line has --free (the arm can home freely, and the boards are in place), or the arm
            is not homed.
        console: for output and questions.
        answer: returns a typed line, or None if nobody can type; default: the terminal.
    """

    confirm: Callable[..., None]
    port: str
    said: bool
    console: Console
    answer: Callable[[], str | None] | None = None

    def __call__(self, run: TaskRun, *plan: Any) -> None:
        """Return only if a person confirms.

        Raises:
            InputError: no confirmation; nothing moved.
        """
        if self.said or not may_be_real(self.port):
            self.confirm(run, *plan)
            return
        if self.answer is None and not at_terminal():
            raise InputError(
                "no terminal to confirm that the cell is clear for homing, which has no collision checks: give --free, "
                "or --homed if the unit was homed since it was switched on",
                option="--free",
            )
        self.confirm(run, *plan)
        self._ask(
            "homing has no collision checks: remove everything from the arm's reach, boards too; then type "
            f"{FREE} (if the unit was homed since it was switched on, end this and give --homed):",
            FREE,
        )
        run.after_homing = lambda: self._ask(
            f"the arm is homed and at q_start: put boards and cubes in place, leave the cage, and type {READY}:",
            READY,
        )

    def _ask(self, question: str, wanted: str) -> None:
        require_word(self.console, question, wanted, self.answer or typed, "nothing more moves", "--free")
