"""The planning budget of a command, and the errors when a search is stopped."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from arm.errors import ImpossibleError, InputError
from driver.line.signals import caught
from plan.budget import BudgetSpent, PlanningInterrupted, SearchBudget, allowed, budget_words


def budget_of(effort_s: float | None, give_up_s: float | None) -> SearchBudget | None:
    """The budget from ``--budget`` and ``--give-up``.

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


@contextmanager
def spending(budget: SearchBudget | None) -> Iterator[None]:
    """Let all planning inside share the budget.

    Raises:
        ImpossibleError: the budget was spent before a plan was complete.
    """
    with allowed(budget):
        try:
            yield
        except BudgetSpent as spent:
            raise ImpossibleError(
                f"{budget_words(spent)}: no complete plan was found",
                budget=spent.by,
                budget_s=spent.allowed_s,
                effort_s=spent.effort_s,
            ) from spent


@contextmanager
def within(budget: SearchBudget | None) -> Iterator[None]:
    """Let all planning inside share the budget, and handle Ctrl-C.

    Raises:
        ImpossibleError: the budget was spent, or Ctrl-C was pressed, before a plan was complete; nothing is written.
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
