"""Budgets of searches, counted in operations instead of seconds. Other modules can import it cheaply.

The unit of effort is one collision check of a configuration, so a request costs the same on every machine and under any
load. Users give budgets in seconds of effort, of `CHECKS_PER_SECOND` collision checks each. Code that does work calls
`spend`, which counts on the meter of the current search (`allowed`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from arm.arguments import integer, number
from arm.errors import A465Error
from arm.former import former_names

if TYPE_CHECKING:
    from arm.plan_file import Plan

# Collision checks per second of one processor core of 2020, measured on failed searches (bench/budget.py).
CHECKS_PER_SECOND = 20_000.0
# Costs of other work, in collision checks.
PIECE_CHECKS = 4.0  # one piece of a clearance certificate, without its distances
DISTANCE_CHECKS = 0.2  # one distance
TORUS_CHECKS = 0.3  # one distance from a torus, in addition
QP_CHECKS = 60.0  # one quadratic program of path optimisation
START_CHECKS = 30.0  # one start of numerical inverse kinematics
LINE_CHECKS = 150.0  # one Cartesian line
STEP_CHECKS = 4.0  # one quadratic program of a line
_LONGEST = 1e6  # s
_CHECKS_PER_READING = 200.0  # collision checks between two readings of the clock


@dataclass(frozen=True)
class TransitBudget:
    """Attempts of each stage of the transit search. A corner in collision costs about 0.01 ms, an edge 0.5 ms.

    Attributes:
        corners: detours over a single random corner, in addition to those that lift the tool.
        corner_edges: collision-free corners whose two edges are checked, the fastest first.
        rrt: nodes of each tree of RRT-Connect; a node costs about 10 collision checks.
        shortcuts: shortcut attempts on the path from RRT-Connect.
        starts: paths with few corners that are optimised; the fastest result is used.
        more_starts: further ones if the fastest is still much slower than the direct motion.
        steps: steps of sequential quadratic programming for the fastest path; the others get a third.

    Raises:
        InputError: an attribute is not a whole number, 0 or more.
    """

    corners: int = 300
    corner_edges: int = 90
    rrt: int = 3000
    shortcuts: int = 40
    starts: int = 2
    more_starts: int = 4
    steps: int = 4

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(
                self, field.name, integer(f"transit.{field.name}", getattr(self, field.name), 0)
            )


@dataclass(frozen=True)
class SearchBudget:
    """Limits on the cost of a search. Plans found within a budget are certified like any other.

    Attributes:
        effort_s: seconds of effort, counted in collision checks. When it is spent, the search returns its best complete
            sequence. The same budget gives the same plan on every machine. None: only the single searches are limited.
        give_up_s: wall time, s, after which the search raises an error, even if it has a plan; so wall time never
            changes a plan. None: no limit.

    Raises:
        InputError: an attribute is not a positive number.
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
    """The budget of a search is spent.

    Not an `ImpossibleError`, because searches skip a candidate on that; public functions convert it to one.

    Args:
        by: ``effort`` or ``clock``.
        effort_s: effort spent, s.
        allowed_s: the budget, s of effort or of wall time.
    """

    exit_code = 3

    def __init__(self, by: str, effort_s: float, allowed_s: float) -> None:
        super().__init__(f"the search's budget of {allowed_s:g} s is spent", by=by, effort_s=effort_s)
        self.by, self.effort_s, self.allowed_s = by, effort_s, allowed_s


class PlanningInterrupted(KeyboardInterrupt):
    """Ctrl-C during planning.

    Args:
        message: progress of the search.
        plan: the best complete plan so far, timed and certified; or None.
    """

    def __init__(self, message: str, plan: Plan | None = None) -> None:
        super().__init__(message)
        self.plan = plan


def budget_words(stop: BudgetSpent | KeyboardInterrupt) -> str:
    """Return the reason why a search ended, in words."""
    if isinstance(stop, KeyboardInterrupt):
        return "the search was interrupted"
    if stop.by == "clock":
        return f"the search was given up after {stop.allowed_s:g} s of wall time"
    return f"the budget of {stop.allowed_s:g} s of effort is spent"


class Meter:
    """Collision checks spent by a search, against its budget."""

    def __init__(self, budget: SearchBudget) -> None:
        self.budget = budget
        self.checks, self._next_reading = 0.0, 0.0
        self.most = float("inf") if budget.effort_s is None else budget.effort_s * CHECKS_PER_SECOND
        self._until = float("inf") if budget.give_up_s is None else time.monotonic() + budget.give_up_s

    @property
    def effort_s(self) -> float:
        """Effort spent, to 0.01 s."""
        return round(self.checks / CHECKS_PER_SECOND, 2)

    def spend(self, checks: float) -> None:
        """Count `checks` collision checks.

        Raises:
            BudgetSpent: the effort or the wall time is spent.
        """
        self.checks += checks
        if self.checks > self.most:
            raise BudgetSpent("effort", self.effort_s, self.budget.effort_s or 0.0)
        if self.checks >= self._next_reading:
            self._next_reading = self.checks + _CHECKS_PER_READING
            if time.monotonic() > self._until:
                raise BudgetSpent("clock", self.effort_s, self.budget.give_up_s or 0.0)

    def lifted(self) -> AbstractContextManager[None]:
        """Suspend the limit on effort in the context, so that a complete plan can still be timed and certified."""
        return self._limited(float("inf"))

    def part(self, share: float) -> AbstractContextManager[None]:
        """Limit the context to the fraction `share` of the remaining effort."""
        return self._limited(self.checks + share * (self.most - self.checks))

    @contextmanager
    def _limited(self, most: float) -> Iterator[None]:
        before, self.most = self.most, most
        try:
            yield
        finally:
            self.most = before


_meter: ContextVar[Meter | None] = ContextVar("meter", default=None)


def spend(checks: float) -> None:
    """Count collision checks on the meter of the current search, if it has one; see `Meter.spend`."""
    meter = _meter.get()
    if meter is not None:
        meter.spend(checks)


@contextmanager
def allowed(budget: SearchBudget | None) -> Iterator[Meter]:
    """Count every `spend` in the context against a budget; without a budget, on the outer meter, if any."""
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


former_names(__name__, __name__, LOOKS_A_SECOND="CHECKS_PER_SECOND")
