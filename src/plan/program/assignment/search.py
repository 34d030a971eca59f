"""A whole task as one problem: which way of gripping and which branch everywhere, which cube next, and to which place.

Everything is ranked by estimates of time that know of no obstacle (`leg_times`, `sequencing`). Only what the best
sequence uses is proved: its lines, and its ways across, straight in joint space. What turns out to be blocked costs
more from then on - for ever where a body that stands still is in the way, or as long as the cube that is in the way
stands there - and the best sequence is asked for again. Where a straight way is blocked and still looks best, a way
around is made, and its own time counts.

One wall blocks many legs alike. So a way around is taken to take as long as the corners of known ways around the same
body let it. Beyond what is ordered exactly, legs that were not looked at are also taken to be blocked where those
between the same two stations were (`leg_costs`); the search ends when no sequence promises more than it allows.

The obstacle-free bounds of the legs give, by the same search over orders, a time that no plan can undercut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.budget import BudgetSpent
from plan.cartesian.reachability import GraspCandidate
from plan.options import PlanOptions
from plan.program.assignment.edge_checks import Blocked, EdgeChecks, TransitQuery, leg_error, line_error
from plan.program.assignment.leg_costs import BEGIN, CARRY, END, GO_ON, NOT_NOW, TransitCosts, TransitEdge
from plan.program.assignment.leg_times import LineEnds, leg_bounds, leg_times, line_ends, standing
from plan.program.assignment.sequencing import (
    Choices,
    Costs,
    Ordered,
    Progress,
    Visit,
    best_grasps,
    best_order,
    lower_bound,
)
from plan.program.assignment.worlds import CubePlacement, TaskWorlds
from plan.transit.optimise import Ends

# Ways around that are made between one pick and one place (and more where there is none yet).
_DETOURS, _DETOURS_AT_MOST = 3, 12
_ROUNDS = 400
# A sequence that could at best be this much faster, in parts, is not looked for; and where legs that were not looked at
# are taken to be blocked like those that were, as beyond what is ordered exactly.
_GOOD_ENOUGH, _ALLOWED = 0.003, 0.025


@dataclass(frozen=True)
class Stop:
    """One cube of a sequence.

    Attributes:
        visit: its numbers.
        pick, place: the choices there.
        before: what stands when the arm sets out for it, itself included.
        out: way-points (m, n) rad to the pick, from where the arm was; from home if `home` of the stop before is set.
        across: to the place.
        home: from the place to where the task starts, or None where the arm goes straight on.
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
    """What the estimated time of a sequence consists of above its bound, s.

    Attributes:
        order: what the bounds of its legs sum up to, more than those of the sequence with the least bound.
        straight: what its legs would take more than their bounds, straight in joint space: joints wait for each other.
        around: what ways around what is there take more.
        unexplored: how much faster a sequence could be by the estimates at the end of the search; not in the sum.
    """

    order: float = 0.0
    straight: float = 0.0
    around: float = 0.0
    unexplored: float = 0.0


@dataclass(frozen=True)
class Found:
    """The best sequence: its stops, its estimated time, what no sequence undercuts, and what lies between, s."""

    stops: tuple[Stop, ...]
    time: float
    bound: float
    gap: Gap = Gap()


class TaskSearch:
    """The search for one task.

    Args:
        stages: its collision worlds.
        picks, places: choices that reach, per transfer and per place, from `plan.cartesian.reachability`.
        q_home: where the arm starts and ends, (n,) rad.
        limits: that motion is planned under.
        options: clearances, lengths, seed, what may be chosen.
    """

    def __init__(
        self,
        stages: TaskWorlds,
        picks: Sequence[Sequence[GraspCandidate]],
        places: Sequence[Sequence[GraspCandidate]],
        q_home: Array,
        limits: Limits,
        options: PlanOptions,
    ) -> None:
        self.stages, self.limits, self.options = stages, limits, options
        # in an order that no rounding can change
        self.picks, self.places = (
            [sorted(choices, key=lambda c: (c.yaw, c.branch)) for choices in side] for side in (picks, places)
        )
        self.freedom = Choices(
            len(self.picks),
            len(self.places),
            order=options.order == "free",
            assignment=options.assignment == "free" and stages.alike,
        )
        tool_speed = options.approach_speed * options.speed
        ends = [
            [line_ends([c.q_line for c in choices], options.offset, limits, tool_speed) for choices in side]
            for side in (self.picks, self.places)
        ]
        self.costs = TransitCosts(ends[0], ends[1], standing(q_home), limits, options)
        self.costs.presume = not self.freedom.exact
        self.detours: dict[tuple[str, tuple[int, ...], CubePlacement | None], int] = {}
        self.most_detours = _DETOURS
        self.proofs = EdgeChecks(stages, limits, options)
        self.rejected: dict[str, ImpossibleError] = {}
        self.stopped: BudgetSpent | KeyboardInterrupt | None = None
        self.complete: Found | None = None

    def best(self) -> Found:
        """The fastest sequence that was found; where the budget is spent or Ctrl-C is pressed, by then (`stopped`).

        Raises:
            BudgetSpent, KeyboardInterrupt: before one was.
            ImpossibleError: none; data: `rejected` says what stopped each choice and leg.
        """
        self.complete = None
        try:
            return self._best()
        except (BudgetSpent, KeyboardInterrupt) as stop:
            # what a clock cut off would differ from time to time
            if self.complete is None or (isinstance(stop, BudgetSpent) and stop.by == "clock"):
                raise
            self.stopped = stop
            return self._explained(self.complete, self.complete.time - self.complete.bound)

    def _best(self) -> Found:
        costs, bounds, promised = self.costs.now(), self.costs.bounds(), np.inf
        bound = lower_bound(self.freedom, bounds, best_order(self.freedom, bounds))
        gain = _ALLOWED if self.costs.presume else _GOOD_ENOUGH
        best: Found | None = None
        for _ in range(_ROUNDS):
            ordered = best_order(self.freedom, costs)
            enough = np.inf if best is None else best.time * (1.0 - gain)
            if ordered is None or ordered.time >= min(enough, NOT_NOW):
                if best is not None:
                    faster = self._polished(best)
                    if (
                        faster.time < best.time and self.costs.presume
                    ):  # ways alike are taken to be faster too
                        best = self.complete = faster
                        continue
                    promised = min(lower_bound(self.freedom, costs, ordered), best.time)
                    best = faster
                    break
                if self.most_detours >= _DETOURS_AT_MOST:
                    break
                self.most_detours = _DETOURS_AT_MOST
                self.proofs.least_margin()
                self.costs.ask_again()
                continue
            best = self.complete = self._proved(ordered, costs, best, bound)
            if self.costs.presume and self.costs.detours.made:
                self._probe()
        if best is None:
            raise self._impossible()
        return self._explained(best, best.time - promised)

    def _explained(self, found: Found, unexplored: float) -> Found:
        """The same sequence with what its time consists of."""
        costs, legs = self.costs, list[tuple[LineEnds, LineEnds]]()
        came = costs.home  # or the place that the arm goes on from
        for stop in found.stops:
            pick = costs.picks[stop.visit.pick].row(stop.visit.pick_way)
            place = costs.places[stop.visit.place].row(stop.visit.place_way)
            legs += [(came, pick), (pick, place), *([] if stop.home is None else [(place, costs.home)])]
            came = place if stop.home is None else costs.home
        bounds, straight = (
            sum(f(*ends, self.limits)[0, 0] for ends in legs) for f in (leg_bounds, leg_times)
        )
        parts = bounds - found.bound, straight - bounds, found.time - straight, max(unexplored, 0.0)
        return replace(found, gap=Gap(*map(float, parts)))

    def _polished(self, found: Found) -> Found:
        """The same sequence with its ways around made faster."""
        saved, stops = 0.0, list[Stop]()

        def polished(way: Array) -> Array:
            nonlocal saved
            if len(way) == 2:
                return way
            leg, way, seconds = self.proofs.polish(way, self._query)
            if seconds > 0.0:
                self.costs.faster(leg, way, seconds)
                saved += seconds
            return way

        for stop in found.stops:
            home = None if stop.home is None else polished(stop.home)
            stops.append(replace(stop, out=polished(stop.out), across=polished(stop.across), home=home))
        return replace(found, stops=tuple(stops), time=found.time - saved)

    def _probe(self) -> None:
        """Look at the fastest leg between any two stations of which nothing is known: most others are like it."""
        there = self.costs.there(Progress(frozenset(), frozenset()))
        for leg in self.costs.fastest_unknown():
            found = self.proofs.straight(leg, self._query(leg), there)
            if not isinstance(found, Blocked):
                self.costs.clear(leg)
            elif found.by is None and not found.end:
                self.costs.block(leg, None, None, found.check.pair[1])

    def _proved(self, ordered: Ordered, costs: Costs, best: Found | None, bound: float) -> Found | None:
        """The best ways that can be proved for the order and places of `ordered`, or `best` if that is faster."""
        pairs = [(visit.pick, visit.place) for visit in ordered.visits]
        current: Ordered | None = ordered
        while current is not None and current.time < NOT_NOW and (best is None or current.time < best.time):
            stops = self._stops(current)
            if stops is not None:
                return Found(stops, current.time, bound)
            current = best_grasps(pairs, costs)
        return best

    def forbid(self, stops: Sequence[Stop], index: int, which: str, error: ImpossibleError) -> None:
        """Do not use a leg of a stop again: ``out``, ``across`` or ``home``; it could not be timed and proved.

        Where that is for one of its lines (data: role), the line is not used again in any leg. Where a cube is in the
        way (data: pair) that may be gone another time, this holds as long as a cube stands there.
        """
        stop, before = stops[index], stops[index - 1] if index else None
        visit, role = stop.visit, error.data.get("role")
        by = self._in_the_way(stops, index, which, error.data.get("pair", ()))
        pick = CubePlacement(False, visit.pick), visit.pick_way
        place = CubePlacement(True, visit.place), visit.place_way
        went_on = before is not None and before.home is None
        came = (
            (CubePlacement(True, before.visit.place), before.visit.place_way) if before and went_on else place
        )
        lines = {"out": (came, pick), "across": (pick, place), "home": (place, place)}
        legs = {
            "across": TransitEdge(CARRY, (visit.pick, visit.place), (visit.pick_way, visit.place_way)),
            "home": TransitEdge(END, (visit.place,), (visit.place_way, 0)),
            "out": TransitEdge(GO_ON, (came[0].number, visit.pick), (came[1], visit.pick_way))
            if went_on
            else TransitEdge(BEGIN, (visit.pick,), (0, visit.pick_way)),
        }
        if role in ("retract", "approach"):
            station, way = lines[which][role == "approach"]
            self.costs.close_line(station, way, by)
        else:
            self.costs.forbid(legs[which], by)
        self._reject(error)

    def _in_the_way(
        self, stops: Sequence[Stop], index: int, which: str, pair: Sequence[str]
    ) -> CubePlacement | None:
        """The cube of a pair that stands there only for a while; None where neither is one.

        Cubes at the leg's own stations stand there whenever it is used.
        """
        stop, cubes = stops[index], self.stages.cubes
        at = {cubes[s.number].name: s for s in stop.before if not s.placed}
        at |= {cubes[s.visit.pick].name: CubePlacement(True, s.visit.place) for s in stops[:index]}
        own = {cubes[stop.visit.pick].name}
        if which == "out" and index and stops[index - 1].home is None:
            own.add(cubes[stops[index - 1].visit.pick].name)
        return next((at[name] for name in pair if name in at and name not in own), None)

    def _stops(self, ordered: Ordered) -> tuple[Stop, ...] | None:
        """The sequence with all that it uses proved, or None where something of it turned out to be blocked."""
        stops: list[Stop] = []
        done, last, whole = Progress(frozenset(), frozenset()), None, True
        for count, visit in enumerate(ordered.visits, start=1):
            there = self.costs.there(done)
            carrying = there - {CubePlacement(False, visit.pick)}
            done = Progress(done.picks | {visit.pick}, done.places | {visit.place})
            after = self.costs.there(done)
            if not self._lines_proved(visit, there, after):
                whole, last = False, None
                continue
            out = None
            if count == 1 or self.options.looks_after(count - 1):
                out = self._across(TransitEdge(BEGIN, (visit.pick,), (0, visit.pick_way)), there)
            elif last is not None:
                leg = TransitEdge(GO_ON, (last.place, visit.pick), (last.place_way, visit.pick_way))
                out = self._across(leg, there)
            across = self._across(
                TransitEdge(CARRY, (visit.pick, visit.place), (visit.pick_way, visit.place_way)), carrying
            )
            home, goes_home = None, count == len(ordered.visits) or self.options.looks_after(count)
            if goes_home:
                home = self._across(TransitEdge(END, (visit.place,), (visit.place_way, 0)), after)
            last = None if goes_home else visit
            if out is None or across is None or (goes_home and home is None):
                whole = False
                continue
            pick, place = (
                self.picks[visit.pick][visit.pick_way],
                self.places[visit.place][visit.place_way],
            )
            stops.append(Stop(visit, pick, place, there, out, across, home))
        return tuple(stops) if whole else None

    def _lines_proved(
        self, visit: Visit, there: frozenset[CubePlacement], after: frozenset[CubePlacement]
    ) -> bool:
        proved = True
        for placed, number, way, now in (
            (False, visit.pick, visit.pick_way, there),
            (True, visit.place, visit.place_way, after),
        ):
            choice = (self.places if placed else self.picks)[number][way]
            blocked = self.proofs.line(choice, CubePlacement(placed, number), visit.pick, now)
            if blocked is not None:
                self.costs.close_line(CubePlacement(placed, number), way, blocked.by)
                self._reject(line_error(choice, blocked.check, self.options.line_clearance))
                proved = False
        return proved

    def _across(self, leg: TransitEdge, now: frozenset[CubePlacement]) -> Array | None:
        """Way-points of a leg's way across, proved; None where it costs more than was thought, which is noted."""
        crossing = self._query(leg)
        found = self.proofs.straight(leg, crossing, now)
        if not isinstance(found, Blocked):
            if len(found) == 2:
                self.costs.clear(leg)
            return found
        by = found.by
        if found.end:
            self._give_up(leg, found)
            return None
        if not self.costs.is_blocked(leg, by):
            self.costs.block(leg, by, None, found.check.pair[1])
            return None
        if self.costs.time(leg, by) is None:
            made = self.detours.get((leg.kind, leg.numbers, by), 0)
            if made >= self.most_detours:
                self.costs.block(leg, by, NOT_NOW)
                return None
            self.detours[leg.kind, leg.numbers, by] = made + 1
        known = self.costs.detours.nearest(found.check.pair[1], self.costs.ends(leg))
        way = self.proofs.around(leg, crossing, now, known, thorough=self.most_detours > _DETOURS)
        if way is None:
            self._give_up(leg, found)
            return None
        return way if self.costs.found(leg, by, way) else None

    def _query(self, leg: TransitEdge) -> TransitQuery:
        out, into = self.costs.ends(leg)
        return TransitQuery(
            out.offset[0],
            into.offset[0],
            Ends(out.velocity[0], -into.velocity[0]),
            leg.numbers[0] if leg.kind == CARRY else None,
            self._own(leg),
        )

    def _give_up(self, leg: TransitEdge, blocked: Blocked) -> None:
        """There is no way for a leg."""
        self.costs.block(leg, blocked.by, np.inf)
        self._reject(leg_error(leg, blocked, self.options.clearance, self.stages))

    def _own(self, leg: TransitEdge) -> frozenset[CubePlacement]:
        """Cubes that stand wherever the leg is used: at its own stations."""
        match leg.kind:
            case "begin":
                return frozenset((CubePlacement(False, leg.numbers[0]),))
            case "go on":
                return frozenset((CubePlacement(True, leg.numbers[0]), CubePlacement(False, leg.numbers[1])))
            case "end":
                return frozenset((CubePlacement(True, leg.numbers[0]),))
        return frozenset()

    def _reject(self, error: ImpossibleError) -> None:
        self.rejected.setdefault(str(error), error)

    def _impossible(self) -> ImpossibleError:
        reasons = list(self.rejected)
        shown = "; ".join(reasons[:2]) + (f"; and {len(reasons) - 2} more" if len(reasons) > 2 else "")
        names = ", ".join(t.cube for t in self.stages.transfers)
        return ImpossibleError(
            f"no way to bring {names} where they should go: {shown}",
            cubes=[t.cube for t in self.stages.transfers],
            rejected=[{"reason": str(e), **e.data} for e in self.rejected.values()],
        )
