"""Advice after a failed plan: changes of the task, verified by planning."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "plan.advice.search", "Advice", "advise")
