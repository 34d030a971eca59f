"""What planning may cost, as a command is told; and the ends of a search that was stopped."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from arm.errors import ImpossibleError, InputError
from driver.line.signals import caught
from plan.budget import BudgetSpent, PlanningInterrupted, SearchBudget, allowed, told_by


def budget_of(effort_s: float | None, give_up_s: float | None) -> SearchBudget | None:
    """The same from ``--budget`` and ``--give-up``.

    Raises:
        InputError: one of them is not a positive number.
    """
    if effort_s is None and give_up_s is None:
        return None
    try:
        return SearchBudget(effort_s, give_up_s)
    except InputError as error:
        text = str(error).replace("effort_s", "--budget").replace("give_up_s", "--give-up")
        raise InputError(text, **error.data) from error


def require_planning(plans: bool, effort_s: float | None, give_up_s: float | None) -> None:
    """A budget goes with what plans.

    Raises:
        InputError: one was given where nothing is planned.
    """
    for option, value in (("--budget", effort_s), ("--give-up", give_up_s)):
        if value is not None and not plans:
            raise InputError(
                f"{option} needs --resume: an execution as planned searches nothing", option=option
            )


@contextmanager
def spending(budget: SearchBudget | None) -> Iterator[None]:
    """All planning inside shares the budget.

    Raises:
        ImpossibleError: it was spent before anything was complete.
    """
    with allowed(budget):
        try:
            yield
        except BudgetSpent as spent:
            raise ImpossibleError(
                f"{told_by(spent)}: nothing complete was found",
                budget=spent.by,
                budget_s=spent.allowed_s,
                effort_s=spent.effort_s,
            ) from spent


@contextmanager
def within(budget: SearchBudget | None) -> Iterator[None]:
    """All planning inside shares the budget.

    Raises:
        ImpossibleError: it was spent, or Ctrl-C pressed, before anything was complete: nothing is to be written.
        PlanningInterrupted: Ctrl-C was pressed, and there is a complete plan.
    """
    with spending(budget):
        try:
            yield
        except PlanningInterrupted as stop:
            caught()
            if stop.plan is None:
                raise ImpossibleError(f"{stop}; nothing was written", budget="interrupt") from stop
            raise
