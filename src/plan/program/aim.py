"""Largest clearance as the objective: the same program, planned with more clearance than is required."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from arm.errors import ImpossibleError
from plan.budget import PlanningInterrupted
from plan.options import PlanOptions
from plan.program.planned import Planned

MOST = 0.1  # m, largest clearance that is tried
_RESOLUTION = 5e-4  # m, resolution of the bisection, or this fraction of the clearance if that is more:
_PART = 0.05
_FAR = "this is the plan with the largest clearance that was found by then"

PlanWith = Callable[[PlanOptions], Planned]


@dataclass(frozen=True)
class _Try:
    options: PlanOptions
    planned: Planned

    def worth(self, weight: float | None) -> tuple[float, ...]:
        """Return the objective: least clearance of all moves, then of transits, m; with `weight` (s per m) their sum
        less the weighted time.
        """
        transits = [move.clearance for move in self.planned.moves if move.role in ("transit", "home")]
        least = self.planned.clearance
        clearances = round(min(least, MOST), 7), round(min((*transits, MOST)), 7)
        if weight is None:
            return clearances
        return (round(sum(clearances) - self.planned.duration_s / weight, 7),)


def clearest(plan_with: PlanWith, options: PlanOptions) -> Planned:
    """Return the plan with the largest clearance, or the best by clearance and time.

    A first bisection finds the largest common clearance of transits and lines, a second one the largest clearance of
    transits alone. Of all plans made, the best one is returned. Without `PlanOptions.clearance_worth` this is the plan
    with the largest clearance of all moves, then of transits; with it, the plan with the largest sum of both clearances
    less the duration over `clearance_worth`.

    Args:
        plan_with: plans the program with the given options.
        options: options of the program; their clearances are lower limits.

    Raises:
        ImpossibleError: there is no plan with the required clearance, or wall time is over (`SearchBudget.give_up_s`).
        PlanningInterrupted: by Ctrl-C; with the best plan by then.
    """
    tried = [_Try(options, plan_with(options))]
    spent: list[str] = []  # why the search for more ended early

    def best() -> Planned:
        return max(tried, key=lambda one: one.worth(options.clearance_worth)).planned

    def bisect(at: Callable[[float], PlanOptions], low: float) -> float:
        high = MOST
        while not spent and high - low > max(_RESOLUTION, _PART * low):
            middle = 0.5 * (low + high)
            asked = at(middle)
            try:
                found = plan_with(asked)
                if len(found.skipped) > len(
                    tried[0].planned.skipped
                ):  # no cube stays for the sake of clearance
                    high = middle
                    continue
                tried.append(_Try(asked, found))
                low = middle
            except ImpossibleError as error:
                if error.data.get("budget") == "clock":  # no plan may depend on wall time
                    raise
                if "budget" in error.data:
                    spent.append(f"the budget of {error.data['budget_s']:g} s of effort is spent")
                high = middle
            except PlanningInterrupted as stop:
                text = f"the search was interrupted: {_FAR}"
                raise PlanningInterrupted(text, replace(best(), stopped=text).plan()) from stop
        return low

    def both(clearance: float) -> PlanOptions:
        return replace(
            options,
            near_ends=False,
            clearance=max(clearance, options.clearance),
            line_clearance=max(clearance, options.line_clearance),
        )

    common = bisect(both, min(options.clearance, options.line_clearance))
    lines = both(common).line_clearance
    bisect(
        lambda clearance: replace(options, near_ends=False, clearance=clearance, line_clearance=lines),
        both(common).clearance,
    )
    return replace(best(), stopped=f"{spent[0]}: {_FAR}") if spent else best()
