"""The search for a whole task: the order of the cubes, their places, grasps and branches, chosen together.

Sequences are ranked by time estimates that ignore obstacles (`leg_times`, `sequencing`). Only what the best sequence
uses is checked, at samples: its lines, and its legs as straight joint motions. A blocked line or leg costs more from
then on: always if a fixed body blocks it, otherwise as long as the blocking cube is there. Then the best sequence is
computed again. If a blocked leg is still part of the best sequence, a detour is planned, and its own time counts.

A wall blocks many legs in the same way. So the assumed time of a detour follows from the corners of known detours
around the same body. If there are too many cubes for exact ordering, a leg that was not checked is assumed to be
blocked if the checked legs between the same two stations are (`leg_costs`). The search ends when no sequence promises
to save more than a small fraction of the time (`_GOOD_ENOUGH`, `_ALLOWED`).

The same search over orders, with the obstacle-free bounds of the legs, gives a lower bound on the time of any plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.budget import BudgetSpent
from plan.cartesian.reachability import GraspCandidate
from plan.options import PlanOptions
from plan.program.assignment.edge_checks import Blocked, EdgeChecks, TransitQuery, leg_error, line_error
from plan.program.assignment.found import Found, Stop, explained
from plan.program.assignment.leg_costs import BEGIN, CARRY, END, GO_ON, NOT_NOW, TransitCosts, TransitEdge
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
from plan.program.goals.leg_times import line_ends, standing
from plan.transit.optimise import Ends

# Largest number of detours between one pick and one place, at first and if no sequence was found.
_DETOURS, _DETOURS_AT_MOST = 3, 12
_ROUNDS = 400
# Fraction of the time that another sequence must promise to save: with exact ordering, and without.
_GOOD_ENOUGH, _ALLOWED = 0.003, 0.025


class TaskSearch:
    """The search for one task.

    Args:
        stages: its collision worlds.
        picks, places: grasps in reach of each transfer and each place, from `plan.cartesian.reachability`.
        q_home: configuration at the start and end, (n,) rad.
        limits: limits for planning.
        options: clearances, lengths, seed, and which choices are free.
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
        # sorted by discrete keys, so that rounding cannot change the order
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
        """Return the fastest sequence; if the budget is spent or Ctrl-C is pressed, the best one by then (`stopped`).

        Raises:
            BudgetSpent, KeyboardInterrupt: before any sequence was complete.
            ImpossibleError: there is none; data: `rejected`, the refusal of each line and leg.
        """
        self.complete = None
        try:
            return self._best()
        except (BudgetSpent, KeyboardInterrupt) as stop:
            # a plan must not depend on wall time
            if self.complete is None or (isinstance(stop, BudgetSpent) and stop.by == "clock"):
                raise
            self.stopped = stop
            return explained(self.complete, self.costs, self.complete.time - self.complete.bound)

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
                    if faster.time < best.time and self.costs.presume:
                        # similar detours are then assumed to be faster too
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
            best = self.complete = self._checked(ordered, costs, best, bound)
            if self.costs.presume and self.costs.detours.made:
                self._probe()
        if best is None:
            raise self._impossible()
        return explained(best, self.costs, best.time - promised)

    def _polished(self, found: Found) -> Found:
        """Return the same sequence with optimised detours."""
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

    def confirm(self, found: Found) -> bool:
        """Certify the transits of a sequence that was found; return whether all are (`EdgeChecks.confirm`)."""
        ways = [way for stop in found.stops for way in (stop.out, stop.across, stop.home) if way is not None]
        return all(self.proofs.confirm(way, self._query) for way in ways)

    def _probe(self) -> None:
        """Check the fastest leg between any two stations without a checked leg, as a sample of the others."""
        there = self.costs.there(Progress(frozenset(), frozenset()))
        for leg in self.costs.fastest_unknown():
            found = self.proofs.straight(leg, self._query(leg), there)
            if not isinstance(found, Blocked):
                self.costs.clear(leg)
            elif found.by is None and not found.end:
                self.costs.block(leg, None, None, found.check.pair[1])

    def _checked(self, ordered: Ordered, costs: Costs, best: Found | None, bound: float) -> Found | None:
        """Return the best clear sequence with the order and places of `ordered`; `best` if that is faster."""
        pairs = [(visit.pick, visit.place) for visit in ordered.visits]
        current: Ordered | None = ordered
        while current is not None and current.time < NOT_NOW and (best is None or current.time < best.time):
            stops = self._stops(current)
            if stops is not None:
                return Found(stops, current.time, bound)
            current = best_grasps(pairs, costs)
        return best

    def forbid(self, stops: Sequence[Stop], index: int, which: str, error: ImpossibleError) -> None:
        """Exclude a leg of a stop (``out``, ``across`` or ``home``) that could not be certified after timing.

        If the error is about one of its lines (data: role), the line is excluded from all legs. If a cube that may be
        elsewhere at another time blocks it (data: pair), it is excluded only while a cube is there.
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
        """Return the cube of a pair that may be elsewhere at another time; None if there is none.

        Cubes at the leg's own stations do not count: they are there whenever the leg is used.
        """
        stop, cubes = stops[index], self.stages.cubes
        at = {cubes[s.number].name: s for s in stop.before if not s.placed}
        at |= {cubes[s.visit.pick].name: CubePlacement(True, s.visit.place) for s in stops[:index]}
        own = {cubes[stop.visit.pick].name}
        if which == "out" and index and stops[index - 1].home is None:
            own.add(cubes[stops[index - 1].visit.pick].name)
        return next((at[name] for name in pair if name in at and name not in own), None)

    def _stops(self, ordered: Ordered) -> tuple[Stop, ...] | None:
        """Return the stops of a sequence if all its lines and legs are clear; otherwise record the blocked ones."""
        stops: list[Stop] = []
        done, last, whole = Progress(frozenset(), frozenset()), None, True
        for count, visit in enumerate(ordered.visits, start=1):
            there = self.costs.there(done)
            carrying = there - {CubePlacement(False, visit.pick)}
            done = Progress(done.picks | {visit.pick}, done.places | {visit.place})
            after = self.costs.there(done)
            if not self._lines_clear(visit, there, after):
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

    def _lines_clear(
        self, visit: Visit, there: frozenset[CubePlacement], after: frozenset[CubePlacement]
    ) -> bool:
        clear = True
        for placed, number, way, now in (
            (False, visit.pick, visit.pick_way, there),
            (True, visit.place, visit.place_way, after),
        ):
            choice = (self.places if placed else self.picks)[number][way]
            blocked = self.proofs.line(choice, CubePlacement(placed, number), visit.pick, now)
            if blocked is not None:
                self.costs.close_line(CubePlacement(placed, number), way, blocked.by)
                self._reject(line_error(choice, blocked.check, self.options.line_clearance))
                clear = False
        return clear

    def _across(self, leg: TransitEdge, now: frozenset[CubePlacement]) -> Array | None:
        """Return the way-points of a leg; None if it costs more than assumed, which is recorded."""
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
        """Record that no path was found for a leg."""
        self.costs.block(leg, blocked.by, np.inf)
        self._reject(leg_error(leg, blocked, self.options.clearance, self.stages))

    def _own(self, leg: TransitEdge) -> frozenset[CubePlacement]:
        """Return the cubes at the leg's own stations, which are there whenever it is used."""
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
            f"{names} cannot be moved to their places: {shown}",
            cubes=[t.cube for t in self.stages.transfers],
            rejected=[{"reason": str(e), **e.data} for e in self.rejected.values()],
        )
