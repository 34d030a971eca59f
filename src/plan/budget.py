"""Budgets of searches, counted in tries and never in seconds; light to import.

What a whole search may cost is counted in looks, one for a configuration that is held against the bodies: the same
request takes the same looks on every machine and under any load. People give it in seconds of effort, `LOOKS_A_SECOND`
looks each. What counts looks calls `spend`; the search that is under way has the meter (`allowed`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from arm.arguments import integer, number
from arm.errors import A465Error

if TYPE_CHECKING:
    from arm.plan_file import Plan

# About what one processor of 2020 does; measured over refused searches (bench/budget.py).
LOOKS_A_SECOND = 20_000.0
# What else costs, in looks.
PROOF_LOOKS = 4.0  # a piece of a motion that is proved, its distances not counted
DISTANCE_LOOKS = 0.2  # a distance
STEP_LOOKS = 60.0  # one step of quadratic programming that makes a way faster
START_LOOKS = 30.0  # one start of numerical inverse kinematics
LINE_LOOKS = 150.0  # a line that is followed
_LONGEST = 1e6  # s
_LOOKS_A_GLANCE = 200.0  # looks between two glances at the clock


@dataclass(frozen=True)
class TransitBudget:
    """Tries of each stage. Costs are about 0.01 ms for a corner that is refused by itself, 0.5 ms for an edge.

    Attributes:
        corners: single corners drawn at random, besides those from lifting the tool.
        corner_edges: corners, the fastest first, that are clear themselves and whose edges are looked at.
        rrt: samples of RRT-Connect.
        shortcuts: tries to cut corners of what RRT-Connect found.
        starts: ways with few corners that are made faster; the fastest is taken.
        more_starts: further ones, where that is still much slower than the straight way.
        steps: of sequential quadratic programming, for the fastest; the others have a third.

    Raises:
        InputError: one of them is not a whole number from 0 on.
    """

    corners: int = 300
    corner_edges: int = 90
    rrt: int = 3000
    shortcuts: int = 40
    starts: int = 2
    more_starts: int = 4
    steps: int = 6

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(
                self, field.name, integer(f"transit.{field.name}", getattr(self, field.name), 0)
            )


@dataclass(frozen=True)
class SearchBudget:
    """What a search may cost; what is found within it is as proved as without.

    Attributes:
        effort_s: seconds of effort, counted in looks: where it is spent, the best complete sequence by then is taken.
            The same budget gives the same plan everywhere. None: no end but those of the single searches.
        give_up_s: wall time after which the search is refused, whatever it has: it changes no plan. None: no end.

    Raises:
        InputError: one of them is not a positive number.
    """

    effort_s: float | None = None
    give_up_s: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is not None:
                checked = number(field.name, value, 1e-3, _LONGEST, "s")
                object.__setattr__(self, field.name, checked)


class BudgetSpent(A465Error):
    """A search has to end. No `ImpossibleError`, which searches take for one way less; their doors make it one.

    Args:
        by: ``effort`` or ``clock``.
        effort_s: spent by then.
        allowed_s: what was allowed, s of effort or of wall time.
    """

    exit_code = 3

    def __init__(self, by: str, effort_s: float, allowed_s: float) -> None:
        super().__init__(f"the search's budget of {allowed_s:g} s is spent", by=by, effort_s=effort_s)
        self.by, self.effort_s, self.allowed_s = by, effort_s, allowed_s


class PlanningInterrupted(KeyboardInterrupt):
    """Ctrl-C while something was planned.

    Args:
        message: how far the search was.
        plan: the best that was complete by then, timed and certified; None where nothing was.
    """

    def __init__(self, message: str, plan: Plan | None = None) -> None:
        super().__init__(message)
        self.plan = plan


def told_by(stop: BudgetSpent | KeyboardInterrupt) -> str:
    """Why a search ended, for people."""
    if isinstance(stop, KeyboardInterrupt):
        return "the search was interrupted"
    if stop.by == "clock":
        return f"the search was given up after {stop.allowed_s:g} s of wall time"
    return f"the budget of {stop.allowed_s:g} s of effort is spent"


class Meter:
    """Looks that a search has taken, and may take."""

    def __init__(self, budget: SearchBudget) -> None:
        self.budget = budget
        self.looks, self._next_glance = 0.0, 0.0
        self.most = float("inf") if budget.effort_s is None else budget.effort_s * LOOKS_A_SECOND
        self._until = float("inf") if budget.give_up_s is None else time.monotonic() + budget.give_up_s

    @property
    def effort_s(self) -> float:
        """Seconds of effort that were spent, to 0.01 s."""
        return round(self.looks / LOOKS_A_SECOND, 2)

    def spend(self, looks: float) -> None:
        """Count looks.

        Raises:
            BudgetSpent: they are more than allowed, or the time is over.
        """
        self.looks += looks
        if self.looks > self.most:
            raise BudgetSpent("effort", self.effort_s, self.budget.effort_s or 0.0)
        if self.looks >= self._next_glance:
            self._next_glance = self.looks + _LOOKS_A_GLANCE
            if time.monotonic() > self._until:
                raise BudgetSpent("clock", self.effort_s, self.budget.give_up_s or 0.0)

    @contextmanager
    def lifted(self) -> Iterator[None]:
        """Inside, effort has no limit: what was found is timed and proved whatever that costs."""
        most, self.most = self.most, float("inf")
        try:
            yield
        finally:
            self.most = most

    @contextmanager
    def part(self, share: float) -> Iterator[None]:
        """Inside, only a share of what is left may be spent."""
        most = self.most
        if most < float("inf"):
            self.most = self.looks + share * (most - self.looks)
        try:
            yield
        finally:
            self.most = most


_meter: ContextVar[Meter | None] = ContextVar("meter", default=None)


def spend(looks: float) -> None:
    """Count looks of the search that is under way, if its caller set a budget; see `Meter.spend`."""
    meter = _meter.get()
    if meter is not None:
        meter.spend(looks)


@contextmanager
def allowed(budget: SearchBudget | None) -> Iterator[Meter]:
    """Inside, what `spend` counts is held against the budget. Without one, an outer one goes on counting."""
    outer = _meter.get()
    if budget is None and outer is not None:
        yield outer
        return
    meter = Meter(budget or SearchBudget())
    token = _meter.set(meter)
    try:
        yield meter
    finally:
        _meter.reset(token)
