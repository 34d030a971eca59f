"""Report what a real arm will do, and ask a person for approval.

A plan file is executed only with the code of its preview (`Approval`). Only the preview shows this code
(`arm.plan_file.Plan.code`), so nobody executes by accident a plan that they have not seen. Commands that plan as they
go have no preview to approve; they ask for the unit's name instead (`Consent`).
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from arm.errors import InputError
from arm.plan_file import Plan, read_plan
from cell.config.calibration_state import calibration_lines
from cell.console import Console
from cell.session.connection import NoImages
from cell.session.dialogue import asked, at_terminal, require_word, typed
from cell.session.homed import which_arm
from cell.session.overview import overview
from cell.task.run import TaskRun
from driver.execution.rest import farthest
from driver.mars.refusals import is_unhomed

ABOUT_GOING_ON = "the arm will not be homed: it continues from where it stands; keep clear"
ABOUT_KEPT = (
    "the arm will not be homed again: that it was homed since it was switched on cannot be verified; compare the joint "
    "angles with the arm, and keep clear"
)
ABOUT_HOMING = "first the controller homes the arm: every axis moves, without collision checks; keep clear"


class Approval:
    """Ask a person for the code of a plan's preview, unless it was given.

    Args:
        plan_file: of the plan to execute.
        code: from the command line, or None to ask at the terminal.
        console: for output and questions.
        answer: returns a typed line, or None if nobody can type; default: the terminal.
        resumes: whether only the rest of the plan is executed, from where the arm is.
        unseen: whether nothing is asked.

    Raises:
        InputError: the code is wrong, or there is neither a code nor a terminal.
    """

    def __init__(
        self,
        plan_file: Path,
        code: str | None,
        console: Console,
        answer: Callable[[], str | None] | None = None,
        resumes: bool = False,
        unseen: bool = False,
    ) -> None:
        self.plan_file, self.plan, self.console = plan_file, read_plan(plan_file), console
        self.resumes = resumes
        self._answer = answer or typed
        self._known = code is not None or unseen
        if code is not None and not self._is_right(code):
            why = f"--yes {code!r}: is not the code shown by the preview of {plan_file}; {self._where()}"
            raise InputError(why, option="--yes", value=code)
        if not self._known and answer is None and not at_terminal():
            raise InputError(
                f"no terminal to confirm {plan_file}: give --yes CODE, the code shown by its preview; "
                f"{self._where()}",
                option="--yes",
            )

    def _is_right(self, code: str) -> bool:
        plain = "".join(filter(str.isalnum, code)).upper()
        return code.isascii() and plain == self.plan.code.replace("-", "")

    def _where(self) -> str:
        page = self.plan_file.with_name(f"{self.plan_file.stem.replace('plan', 'preview', 1)}.html")
        shown = page.is_file() and self.plan.code in page.read_text(errors="replace")
        return f"open {page}" if shown else f"a465 preview {self.plan_file} writes the preview"

    def __call__(self, run: TaskRun, plan: Plan) -> None:
        """Report what will move, and return only if the code was given.

        Args:
            run: the run that needs the approval.
            plan: the plan to execute; the file may have changed since it was read here.

        Raises:
            InputError: the code was not given, or the plan differs; nothing moved.
        """
        if plan.code != self.plan.code:
            why = f"{self.plan_file}: changed while it was being read; check its preview, and try again"
            raise InputError(why, file=str(self.plan_file))
        self._report(run)
        if self._known:
            return
        question = f"type the code shown by the preview of this plan ({self._where()}):"
        if not asked(self.console, question, "the code of this plan", self._is_right, self._answer):
            why = f"{self.plan_file}: was not confirmed with the code of its preview; nothing moved"
            raise InputError(why, option="--yes")

    def _report(self, run: TaskRun) -> None:
        plan, cell, say = self.plan, run.task.cell, self.console.say
        of = overview(plan, cell.robot_holding(), cell.unit)
        factor = run.control.ceiling
        cubes, lasts = len(plan.task["cubes"]), f"{plan.duration_s / factor:.0f} s of motion"
        what = f"{cubes} cube{'s' if cubes > 1 else ''}" if cubes else "the plan"
        if self.resumes:
            say(f"this moves {_arm(run)}: the rest of {what}, at most {lasts}")
            say("the table is for the whole plan; the rest of it is replanned, within the same limits:")
        else:
            say(f"this moves {_arm(run)}: {f'{what}, ' if cubes else ''}{lasts}")
        limits = cell.unit.limits(plan.speed_registers, plan.acceleration_registers).velocity
        fastest = factor * of.fastest
        columns = (of.lowest, of.highest, of.travel)
        self.console.table(
            ("joint", "lowest deg", "highest deg", "travel deg", "max deg/s", "of the limit"),
            [
                (
                    f"J{j + 1}",
                    *(_degrees(column[j]) for column in columns),
                    f"{np.degrees(fastest[j]):.1f}",
                    f"{100 * fastest[j] / limits[j]:.0f} %",
                )
                for j in range(len(limits))
            ],
        )
        near = " - ".join(name for name in of.closest if name)
        say(
            f"tool: at most {1e3 * factor * of.tool:.0f} mm/s; clearance: at least {1e3 * of.clearance:.1f} mm"
            + (f" ({near})" if near else "")
        )
        for line in (cell.arm_shape(), *calibration_lines(cell, _looks(run))):
            say(line)
        say(f"the arm: {_place(run)}")
        say(ABOUT_GOING_ON if self.resumes else ABOUT_KEPT if run.homed_before else ABOUT_HOMING)
        if not self.resumes and not _is_at_start(run, plan):
            say(_way_to_start(run, plan))


class Consent:
    """Ask a person whether plans without a preview may move a real arm, unless the command line says so.

    Args:
        said: whether the command line has --unseen.
        console: for output and questions.
        answer: returns a typed line, or None if nobody can type; default: the terminal.
    """

    def __init__(self, said: bool, console: Console, answer: Callable[[], str | None] | None = None) -> None:
        self.said, self.console, self._answer = said, console, answer

    def __call__(self, run: TaskRun) -> None:
        """Report what will move, and return only with a person's consent.

        Raises:
            InputError: no consent; nothing moved.
        """
        if not self.said and self._answer is None and not at_terminal():
            raise InputError(
                "no terminal to confirm that a real arm may execute plans without a preview: give --unseen, or use the "
                "commands look, plan, preview and execute instead",
                option="--unseen",
            )
        name, say = run.task.cell.unit.name, self.console.say
        say(
            f"this moves {_arm(run)}, {name}, by plans made as the command runs: certified, but without a preview"
        )
        say(f"speed: {100 * run.speed:.0f} % of the cell file's registers; the arm: {_place(run)}")
        for line in calibration_lines(run.task.cell, _looks(run)):
            say(line)
        say(ABOUT_KEPT if run.homed_before else ABOUT_HOMING)
        if self.said:
            return
        question = f"type {name} to let it move:"
        require_word(self.console, question, name, self._answer or typed, "nothing moved", "--unseen")


def _arm(run: TaskRun) -> str:
    return which_arm(run.connection.mars.link.url)


def _looks(run: TaskRun) -> bool:
    """Whether the run has a camera, whose lens counts."""
    return not isinstance(run.connection.frames, NoImages)


def _is_at_start(run: TaskRun, plan: Plan) -> bool:
    """Whether the plan begins where the arm is, which will not be homed."""
    counters = run.connection.mars.counters()
    return run.homed_before and farthest(counters, plan.start) <= run.task.cell.unit.rest_tolerance


def _way_to_start(run: TaskRun, plan: Plan) -> str:
    """The motion before the plan's first move in words; how far each joint goes, if no homing comes before it."""
    unit = run.task.cell.unit
    begin = "its present configuration" if run.homed_before else "where homing leaves it"
    text = (
        f"before the plan, the arm moves from {begin} to the plan's start; this motion is not in the preview or the "
        "table: it is planned after a look and certified, or refused"
    )
    if not run.homed_before:
        return text
    far = unit.positions(plan.start) - unit.positions(run.connection.mars.counters())
    return f"{text}; the joints turn by [{', '.join(map(_degrees, far))}] deg, further if it must go around something"


def _place(run: TaskRun) -> str:
    """The arm's position in words, from its counters."""
    counters = run.connection.mars.counters()
    if is_unhomed(run.task.cell.unit, counters):
        return "not homed since it was switched on, so its position is not known"
    at = ", ".join(map(_degrees, run.task.cell.unit.positions(counters)))
    return f"at [{at}] deg by its counters, which are correct if it was homed since it was switched on"


def _degrees(angle: float) -> str:
    """An angle in rad as whole degrees, without a sign at 0."""
    return f"{np.round(np.degrees(angle)) + 0.0:.0f}"
