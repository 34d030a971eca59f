"""The search for a whole task: the order of the cubes, their places, grasps and branches, chosen together.

Sequences are ranked by time estimates that ignore obstacles (`leg_times`, `sequencing`). Only what the best sequence
uses is checked, at samples: its lines, and its legs as straight joint motions. A blocked line or leg costs more from
then on: always if a fixed body blocks it, otherwise as long as the blocking cube is there. Then the best sequence is
computed again. If a blocked leg is still part of the best sequence, a detour is planned, and its own time counts.

A wall blocks many legs in the same way. So the assumed time of a detour follows from the corners of known detours
around the same body. If there are too many cubes for exact ordering, a leg that was not checked is assumed to be
blocked if the checked legs between the same two sites are (`leg_costs`). The search ends when no sequence promises
to save more than a small fraction of the time (`_GOOD_ENOUGH`, `_ALLOWED`).

The same search over orders, with the obstacle-free bounds of the legs, gives a lower bound on the time of any plan.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array
from plan.budget import BudgetSpent
from plan.cartesian.reachability import GraspCandidate
from plan.program.assignment.edge_checks import Blocked, EdgeChecks, leg_error, line_error
from plan.program.assignment.found import Found, PlannedLeg, explained
from plan.program.assignment.leg_costs import POSTPONED, LegCosts
from plan.program.assignment.legs import AT_HOME, HOME, Arrangement, Leg, Site, Stop
from plan.program.assignment.sequencing import Choices, Costs, Ordered, best_grasps, best_order, lower_bound
from plan.program.assignment.worlds import TaskWorlds
from plan.program.goals.leg_times import LineEnds, line_ends, standing
from plan.program.setting import Setting

# Largest number of detours between one pick and one place, at first and if no sequence was found.
_DETOURS, _DETOURS_AT_MOST = 3, 12
_ROUNDS = 400
# Fraction of the time that another sequence must promise to save: with exact ordering, and without.
_GOOD_ENOUGH, _ALLOWED = 0.003, 0.025


class TaskSearch:
    """The search for one task.

    Args:
        setting: limits, clearances, lengths, seed, and which choices are free.
        worlds: its collision worlds.
        grasps: grasps in reach at each site, from `plan.cartesian.reachability`.
        q_home: configuration at the start and end, (n,) rad.

    Attributes:
        stopped: why the search ended before the fastest sequence was known, or None.
    """

    def __init__(
        self,
        setting: Setting,
        worlds: TaskWorlds,
        grasps: Mapping[Site, Sequence[GraspCandidate]],
        q_home: Array,
    ) -> None:
        self.worlds, self.options = worlds, setting.options
        limits, options = setting.planned, setting.options
        # sorted by discrete keys, so that rounding cannot change the order
        self.grasps = {site: sorted(some, key=lambda c: (c.yaw, c.branch)) for site, some in grasps.items()}
        self.choices = Choices(
            len(worlds.cubes),
            len(worlds.places),
            order=options.order == "free",
            assignment=options.assignment == "free" and worlds.alike,
        )
        lines: dict[Site, LineEnds] = {HOME: standing(q_home)}
        for site, some in self.grasps.items():
            q_lines = [grasp.q_line for grasp in some]
            lines[site] = line_ends(q_lines, options.offset, limits, setting.tool_speed)
        self.costs = LegCosts(lines, limits, options)
        self.costs.assume_alike = not self.choices.exact
        self.detours: dict[tuple[object, ...], int] = {}
        self.most_detours = _DETOURS
        self.edges = EdgeChecks(setting, worlds, lines, self.costs.assume_alike)
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
        bound = lower_bound(self.choices, bounds, best_order(self.choices, bounds))
        gain = _ALLOWED if self.costs.assume_alike else _GOOD_ENOUGH
        best: Found | None = None
        for _ in range(_ROUNDS):
            ordered = best_order(self.choices, costs)
            enough = np.inf if best is None else best.time * (1.0 - gain)
            if ordered.time >= min(enough, POSTPONED):
                if best is not None:
                    faster = self._polished(best)
                    if faster.time < best.time and self.costs.assume_alike:
                        # similar detours are then assumed to be faster too
                        best = self.complete = faster
                        continue
                    promised = min(lower_bound(self.choices, costs, ordered), best.time)
                    best = faster
                    break
                if self.most_detours >= _DETOURS_AT_MOST:
                    break
                self.most_detours = _DETOURS_AT_MOST
                self.edges.least_margin()
                self.costs.retry()
                continue
            best = self.complete = self._checked(ordered, costs, best, bound)
            if self.costs.assume_alike and self.costs.detours.made:
                self._probe()
        if best is None:
            raise self._impossible()
        return explained(best, self.costs, best.time - promised)

    def _polished(self, found: Found) -> Found:
        """Return the same sequence with optimised detours."""
        saved, legs = 0.0, list[PlannedLeg]()
        for planned in found.legs:
            path, seconds = planned.path, 0.0
            if len(path) > 2:
                path, seconds = self.edges.polish(planned.leg, planned.there, path)
            if seconds > 0.0:
                self.costs.faster(planned.leg, path, seconds)
                saved += seconds
            legs.append(replace(planned, path=path))
        return replace(found, legs=tuple(legs), time=found.time - saved)

    def confirm(self, found: Found) -> bool:
        """Certify the transits of a sequence that was found; return whether all are (`EdgeChecks.confirm`)."""
        return all(self.edges.confirm(planned.leg, planned.there, planned.path) for planned in found.legs)

    def _probe(self) -> None:
        """Check the fastest leg between any two sites without a checked leg, as a sample of the others."""
        for leg in self.costs.fastest_unchecked():
            found = self.edges.straight(leg, self.worlds.start)
            if not isinstance(found, Blocked):
                self.costs.clear(leg)
            elif found.by is None and not found.end:
                self.costs.block(leg, None, None, found.check.pair[1])

    def _checked(self, ordered: Ordered, costs: Costs, best: Found | None, bound: float) -> Found | None:
        """Return the best clear sequence with the order and places of `ordered`; `best` if that is faster."""
        while ordered.time < (POSTPONED if best is None else min(best.time, POSTPONED)):
            legs = self._legs(ordered)
            if legs is not None:
                return Found(legs, ordered.time, bound)
            ordered = best_grasps(ordered.pairs, costs)
        return best

    def forbid(self, legs: Sequence[PlannedLeg], index: int, error: ImpossibleError) -> None:
        """Exclude a leg that could not be certified after timing.

        If the error is about one of its lines (data: role), the line is excluded from all legs. If a cube that may be
        elsewhere at another time blocks it (data: pair), it is excluded only while a cube is there.
        """
        leg, role = legs[index].leg, error.data.get("role")
        by = self._in_the_way(legs, index, error.data.get("pair", ()))
        if role in ("retract", "approach"):
            self.costs.close_line(leg.goal if role == "approach" else leg.origin, by)
        else:
            self.costs.forbid(leg, by)
        self._reject(error)

    def _in_the_way(self, legs: Sequence[PlannedLeg], index: int, pair: Sequence[str]) -> Site | None:
        """Return the site of a cube of a pair that may be elsewhere at another time; None if there is none.

        Cubes at the leg's own sites do not count: they are there whenever the leg is used.
        """
        sources = {planned.leg.goal.site: planned.leg.origin.site for planned in legs[:index]}
        at = {}
        for site in legs[index].there - set(legs[index].leg.sites):
            source = sources[site] if site.placed else site
            at[self.worlds.cubes[source.number].name] = site
        return next((at[name] for name in pair if name in at), None)

    def _legs(self, ordered: Ordered) -> tuple[PlannedLeg, ...] | None:
        """Return the legs of a sequence if all its lines and legs are clear; otherwise record the blocked ones."""
        legs: list[PlannedLeg] = []
        complete, there = True, self.worlds.start
        at: Stop | None = AT_HOME  # None after a place whose lines are blocked
        stops = list(zip(ordered.stops[::2], ordered.stops[1::2], strict=True))
        for count, (pick, place) in enumerate(stops, start=1):
            carrying = there - {pick.site}
            after = carrying | {place.site}
            returns = count == len(stops) or self.options.looks_after(count)
            clear = self._lines_clear(pick, place, there, after)
            complete = complete and clear and at is not None
            if clear:
                leaving = [(place, AT_HOME, after)] if returns else []
                for origin, goal, now in ((at, pick, there), (pick, place, carrying), *leaving):
                    path = None if origin is None else self._path(Leg(origin, goal), now)
                    if origin is None or path is None:
                        complete = False
                        continue
                    grasp = None if goal == AT_HOME else self.grasps[goal.site][goal.grasp]
                    legs.append(PlannedLeg(Leg(origin, goal), grasp, now, path))
            at, there = AT_HOME if returns else place if clear else None, after
        return tuple(legs) if complete else None

    def _lines_clear(self, pick: Stop, place: Stop, there: Arrangement, after: Arrangement) -> bool:
        clear = True
        for stop, now in ((pick, there), (place, after)):
            grasp = self.grasps[stop.site][stop.grasp]
            blocked = self.edges.line(grasp, stop.site, pick.site.number, now)
            if blocked is not None:
                self.costs.close_line(stop, blocked.by)
                self._reject(line_error(grasp, blocked, self.options.line_clearance))
                clear = False
        return clear

    def _path(self, leg: Leg, now: Arrangement) -> Array | None:
        """Return the way-points of a leg; None if it costs more than assumed, which is recorded."""
        found = self.edges.straight(leg, now)
        if not isinstance(found, Blocked):
            if len(found) == 2:
                self.costs.clear(leg)
            return found
        by, body = found.by, found.check.pair[1]
        if found.end:
            self._give_up(leg, found)
            return None
        if not self.costs.is_blocked(leg, by):
            self.costs.block(leg, by, None, body)
            return None
        if self.costs.time(leg, by) is None:
            made = self.detours.get((leg.sites, by), 0)
            if made >= self.most_detours:
                self.costs.block(leg, by, POSTPONED)
                return None
            self.detours[leg.sites, by] = made + 1
        known = self.costs.detours.nearest(body, self.costs.ends(leg))
        path = self.edges.around(leg, now, known, thorough=self.most_detours > _DETOURS)
        if path is None:
            self._give_up(leg, found)
            return None
        return path if self.costs.found(leg, by, path) else None

    def _give_up(self, leg: Leg, blocked: Blocked) -> None:
        """Record that no path was found for a leg."""
        self.costs.block(leg, blocked.by, np.inf)
        self._reject(leg_error(leg, blocked, self.options.clearance, self.worlds))

    def _reject(self, error: ImpossibleError) -> None:
        self.rejected.setdefault(str(error), error)

    def _impossible(self) -> ImpossibleError:
        reasons = list(self.rejected)
        shown = "; ".join(reasons[:2]) + (f"; and {len(reasons) - 2} more" if len(reasons) > 2 else "")
        names = ", ".join(t.cube for t in self.worlds.transfers)
        return ImpossibleError(
            f"{names} cannot be moved to their places: {shown}",
            cubes=[t.cube for t in self.worlds.transfers],
            rejected=[{"reason": str(e), **e.data} for e in self.rejected.values()],
        )
