"""A sequence that was found, and what its time consists of."""

from __future__ import annotations

from dataclasses import dataclass, replace

from arm.se3 import Array
from plan.cartesian.reachability import GraspCandidate
from plan.program.assignment.leg_costs import LegCosts
from plan.program.assignment.legs import Arrangement, Leg
from plan.program.goals.leg_times import leg_bounds, leg_times


@dataclass(frozen=True)
class PlannedLeg:
    """One leg of a sequence.

    Attributes:
        leg: its ends.
        grasp: the grasp at its goal; None at home.
        there: the arrangement while it is used.
        path: way-points (m, n) rad, clear at samples.
    """

    leg: Leg
    grasp: GraspCandidate | None
    there: Arrangement
    path: Array


@dataclass(frozen=True)
class Gap:
    """Excess of a sequence's estimated time over its lower bound by cause, s.

    Attributes:
        order: sum of the bounds of its legs, less that of the sequence with the least sum.
        straight: excess of straight joint motions over their bounds, because joints wait for each other.
        around: excess of detours over straight joint motions.
        unexplored: how much faster another sequence could be, by the estimates at the end; not in the sum.
    """

    order: float = 0.0
    straight: float = 0.0
    around: float = 0.0
    unexplored: float = 0.0


@dataclass(frozen=True)
class Found:
    """The best sequence: its legs in order, its estimated time, its lower bound, and the excess by cause, s."""

    legs: tuple[PlannedLeg, ...]
    time: float
    bound: float
    gap: Gap = Gap()


def explained(found: Found, costs: LegCosts, unexplored: float) -> Found:
    """Return the sequence with the excess of its time by cause; `unexplored` as in `Gap`, s."""
    ends = [costs.ends(planned.leg) for planned in found.legs]
    bounds, straight = (sum(f(*pair, costs.limits)[0, 0] for pair in ends) for f in (leg_bounds, leg_times))
    parts = bounds - found.bound, straight - bounds, found.time - straight, max(unexplored, 0.0)
    return replace(found, gap=Gap(*map(float, parts)))
