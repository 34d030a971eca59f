"""Advice after a failed plan: changes of the task, verified by planning."""

from arm.former import former_names

former_names(__name__, "plan.advice.search", "Advice", "advise")
