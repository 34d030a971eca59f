"""Before a real arm moves: a person is told what will move, and says yes.

A plan file is executed with the code of its preview (`Approval`), which stands there alone (`arm.plan_file.Plan.code`):
nobody runs by accident what nobody has seen. Commands that plan as they go have no preview to be seen before; they are
told to by the unit's name (`Consent`).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from arm.errors import InputError
from arm.plan_file import Plan, read_plan
from cell.console import Console
from cell.scene.arm_shape import arm_shape
from cell.session.dialogue import asked, at_terminal, typed
from cell.session.overview import overview
from cell.task.run import TaskRun
from driver.mars.refusals import is_unhomed

ABOUT_GOING_ON = "nothing is homed: it goes on from where the arm stands; keep clear"
ABOUT_KEPT = (
    "nothing is homed: --homed says that it was; compare the joint angles with the arm, and keep clear"
)
ABOUT_HOMING = "first the controller homes the arm: every axis moves, and nothing checks its way; keep clear"


class Approval:
    """Asks a person for the code of a plan's preview, unless it was given.

    Args:
        plan_file: that is to be executed.
        code: given on the command line, or None to ask for it at the terminal.
        console: where it is told and asked.
        answer: gives a line that was typed, None if there is nobody to type; default: the terminal.
        resumes: whether only what is left of the plan is done, from where the arm is.

    Raises:
        InputError: the code is of no preview of this plan, or there is neither a code nor a terminal.
    """

    def __init__(
        self,
        plan_file: Path,
        code: str | None,
        console: Console,
        answer: Callable[[], str | None] | None = None,
        resumes: bool = False,
    ) -> None:
        self.plan_file, self.plan, self.console = plan_file, read_plan(plan_file), console
        self.resumes = resumes
        self._answer = answer or typed
        self._known = code is not None
        if code is not None and not self._is_right(code):
            raise InputError(
                f"--yes {code!r}: is not the code that the preview of {plan_file} shows; {self._where()}",
                option="--yes",
                value=code,
            )
        if code is None and answer is None and not at_terminal():
            raise InputError(
                f"nobody is there to confirm {plan_file} on a real arm: give --yes CODE, the code that its preview "
                f"shows; {self._where()}",
                option="--yes",
            )

    def _is_right(self, code: str) -> bool:
        return code.isascii() and "".join(filter(str.isalnum, code)).upper() == self.plan.code.replace(
            "-", ""
        )

    def _where(self) -> str:
        return f"a465 preview {self.plan_file} writes the preview"

    def __call__(self, run: TaskRun, plan: Plan) -> None:
        """Tell what will move, and go on only with the code.

        Args:
            run: that asks.
            plan: that it will send; the file may have changed since it was read here.

        Raises:
            InputError: it was not given, or the plan is another one; nothing moved.
        """
        if plan.code != self.plan.code:
            raise InputError(
                f"{self.plan_file}: was changed while it was read; see its preview, and try again",
                file=str(self.plan_file),
            )
        self._tell(run)
        if self._known:
            return
        question = f"the code that the preview of this plan shows ({self._where()}):"
        if not asked(self.console, question, "the code of this plan", self._is_right, self._answer):
            raise InputError(
                f"{self.plan_file}: was not confirmed with the code of its preview; nothing moved",
                option="--yes",
            )

    def _tell(self, run: TaskRun) -> None:
        plan, cell, say = self.plan, run.task.cell, self.console.say
        of = overview(plan, cell.robot(cell.cube_size), cell.unit)
        factor = run.control.ceiling
        cubes = len(plan.task["cubes"])
        what = f"{cubes} cube{'' if cubes == 1 else 's'}" if cubes else "no cube"
        if self.resumes:
            say(
                f"this moves the real arm: what is left of {what}, at most {plan.duration_s / factor:.0f} s of motion"
            )
            say(
                "the whole plan, of which some was done; what is left is planned anew, within the same limits:"
            )
        else:
            say(f"this moves the real arm: {what}, {plan.duration_s / factor:.0f} s of motion")
        limits = cell.unit.limits(plan.speed_registers, plan.acceleration_registers).velocity
        fastest = factor * of.fastest
        columns = (of.lowest, of.highest, of.travel)
        self.console.table(
            ("joint", "from deg", "to deg", "way deg", "deg/s at most", "of the limit"),
            [
                (
                    f"J{j + 1}",
                    *(f"{np.degrees(column[j]):.0f}" for column in columns),
                    f"{np.degrees(fastest[j]):.1f}",
                    f"{100 * fastest[j] / limits[j]:.0f} %",
                )
                for j in range(len(limits))
            ],
        )
        near = " - ".join(name for name in of.closest if name)
        say(
            f"tool: {1e3 * factor * of.tool:.0f} mm/s at most; clearance: {1e3 * of.clearance:.1f} mm at least"
            + (f" ({near})" if near else "")
        )
        say(arm_shape(cell))
        say(f"the arm: {_place(run)}")
        say(ABOUT_GOING_ON if self.resumes else ABOUT_KEPT if run.homed_before else ABOUT_HOMING)


class Consent:
    """Asks a person whether plans that nobody has seen may move a real arm, unless that was said.

    Args:
        said: on the command line, by --unseen.
        console: where it is told and asked.
        answer: gives a line that was typed, None if there is nobody to type; default: the terminal.
    """

    def __init__(self, said: bool, console: Console, answer: Callable[[], str | None] | None = None) -> None:
        self.said, self.console, self._answer = said, console, answer

    def __call__(self, run: TaskRun) -> None:
        """Tell what will move, and go on only if a person says so.

        Raises:
            InputError: nobody did; nothing moved.
        """
        if not self.said and self._answer is None and not at_terminal():
            raise InputError(
                "nobody is there to let a real arm move by plans that nobody has seen: give --unseen, or look, plan, "
                "preview and execute, each a command",
                option="--unseen",
            )
        name, say = run.task.cell.unit.name, self.console.say
        say(
            f"this moves the real arm, {name}, by plans that are made on the way: certified, but seen by nobody before"
        )
        say(f"speed: {100 * run.speed:.0f} % of the cell file's registers; the arm: {_place(run)}")
        say(ABOUT_KEPT if run.homed_before else ABOUT_HOMING)
        if self.said:
            return
        question = f"type {name} to let it move:"
        if not asked(
            self.console,
            question,
            name,
            _same_name(name),
            self._answer or typed,
        ):
            raise InputError("nobody let the arm move; nothing moved", option="--unseen")


def _same_name(name: str) -> Callable[[str], bool]:
    return lambda typed: typed.lower() == name.lower()


def _place(run: TaskRun) -> str:
    """Where the arm is, by its counters."""
    counters = run.connection.mars.counters()
    if is_unhomed(run.task.cell.unit, counters):
        return "not homed since it was switched on, so its place is not known"
    degrees = ", ".join(
        f"{d:.0f}" for d in np.round(np.degrees(run.task.cell.unit.positions(counters))) + 0.0
    )
    return f"at [{degrees}] deg by its counters, which are right if it was homed since it was switched on"


def require_a_port(option: str, given: bool, port: str | None) -> None:
    """What a person says of a real arm is of no use without one.

    Raises:
        InputError: the option was given, and no port.
    """
    if given and port is None:
        raise InputError(f"{option} goes with --port: the simulated cell asks for nothing", option=option)
