"""A sequence that was found, and what its time consists of."""

from __future__ import annotations

from dataclasses import dataclass, replace

from arm.se3 import Array
from plan.cartesian.reachability import GraspCandidate
from plan.program.assignment.leg_costs import TransitCosts
from plan.program.assignment.sequencing import Visit
from plan.program.assignment.worlds import CubePlacement
from plan.program.goals.leg_times import LineEnds, leg_bounds, leg_times


@dataclass(frozen=True)
class Stop:
    """One cube of a sequence.

    Attributes:
        visit: numbers of its pick, place and grasps.
        pick, place: the grasps.
        before: cubes at rest before the pick, itself included.
        out: way-points (m, n) rad to the pick, from home or from the previous place.
        across: way-points from the pick to the place.
        home: way-points from the place to the start of the task; None if the arm goes on to the next pick.
    """

    visit: Visit
    pick: GraspCandidate
    place: GraspCandidate
    before: frozenset[CubePlacement]
    out: Array
    across: Array
    home: Array | None


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
    """The best sequence: its stops, its estimated time, its lower bound, and the excess by cause, s."""

    stops: tuple[Stop, ...]
    time: float
    bound: float
    gap: Gap = Gap()


def explained(found: Found, costs: TransitCosts, unexplored: float) -> Found:
    """Return the sequence with the excess of its time by cause; `unexplored` as in `Gap`, s."""
    legs = list[tuple[LineEnds, LineEnds]]()
    came = costs.home  # or the previous place
    for stop in found.stops:
        pick = costs.picks[stop.visit.pick].row(stop.visit.pick_way)
        place = costs.places[stop.visit.place].row(stop.visit.place_way)
        legs += [(came, pick), (pick, place), *([] if stop.home is None else [(place, costs.home)])]
        came = place if stop.home is None else costs.home
    bounds, straight = (sum(f(*ends, costs.limits)[0, 0] for ends in legs) for f in (leg_bounds, leg_times))
    parts = bounds - found.bound, straight - bounds, found.time - straight, max(unexplored, 0.0)
    return replace(found, gap=Gap(*map(float, parts)))
