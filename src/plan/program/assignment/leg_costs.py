"""What the legs of a task are taken to cost: estimates of time, and what was learnt to be in the way.

A leg goes from one choice to another: from the start to a pick, with the cube to a place, from a place to a pick, or to
the end. What is in the way of its straight form may be a cube, and then only counts as long as that stands there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.options import PlanOptions
from plan.program.assignment.leg_times import LineEnds, leg_bounds, leg_times
from plan.program.assignment.sequencing import Costs, Progress
from plan.program.assignment.worlds import CubePlacement
from plan.trajectory.time_estimates import path_time

# Kinds of legs.
BEGIN, CARRY, GO_ON, END = "begin", "carry", "go on", "end"
# Time of a leg that is not tried for want of budget, s.
NOT_NOW = 1e9
# What a way around is taken to cost before one was made, in parts of the straight way and s; and in parts of the least
# that one between the same stations was found to cost.
_OVERHEAD, _OVERHEAD_S, _ALIKE = 0.02, 0.05, 0.85
# A way around that costs this much more than the straight one, in parts, is worth more tries.
_POOR = 0.1
# A way around that takes this much longer than was thought, in parts, is not a reason to ask again.
_NEAR = 0.03

Moment = frozenset[CubePlacement]
Table = dict[str, list[list[Array]]]


@dataclass(frozen=True)
class TransitEdge:
    """A way across: its kind, the numbers of pick and place that it joins, and the choice at each end (or 0)."""

    kind: str
    numbers: tuple[int, ...]
    ways: tuple[int, int]


class TransitCosts:
    """Times of all legs of a task, and what is known to be in their way.

    Args:
        picks, places: the lines of every choice, per pick and per place.
        home: where the task starts and ends.
        limits: that motion is planned under.
        options: which looks are asked for.

    Attributes:
        free: estimates with nothing in the way, per kind and numbers, (ways, ways) s.
    """

    def __init__(
        self,
        picks: Sequence[LineEnds],
        places: Sequence[LineEnds],
        home: LineEnds,
        limits: Limits,
        options: PlanOptions,
    ) -> None:
        self.picks, self.places, self.home = picks, places, home
        self.limits, self.options = limits, options
        self.free = self._table(leg_times)
        # per leg and what is in its way: the time of a way around, or None where none was made yet
        self._blocked: dict[
            tuple[str, tuple[int, ...]], dict[tuple[int, int, CubePlacement | None], float | None]
        ] = {}
        self._forbidden: set[tuple[str, tuple[int, ...], tuple[int, int, CubePlacement | None]]] = set()
        self._excess: dict[tuple[str, tuple[int, ...]], float] = {}
        self._lines: dict[CubePlacement, set[tuple[int, CubePlacement | None]]] = {}

    def now(self) -> Costs:
        """Estimates with all that is known to be in the way."""
        return self._costs(self.free, self._with_blocks)

    def bounds(self) -> Costs:
        """Lower bounds, whatever is in the way."""
        return self._costs(self._table(leg_bounds), None)

    def there(self, done: Progress) -> Moment:
        """Which cubes stand, and where."""
        left = (CubePlacement(False, i) for i in range(len(self.picks)) if i not in done.picks)
        return frozenset(left) | frozenset(CubePlacement(True, j) for j in done.places)

    def ends(self, leg: TransitEdge) -> tuple[LineEnds, LineEnds]:
        """The two ends of a leg, one row each."""
        a, b = leg.ways
        match leg.kind:
            case "begin":
                return self.home, self.picks[leg.numbers[0]].row(b)
            case "carry":
                return self.picks[leg.numbers[0]].row(a), self.places[leg.numbers[1]].row(b)
            case "go on":
                return self.places[leg.numbers[0]].row(a), self.picks[leg.numbers[1]].row(b)
        return self.places[leg.numbers[0]].row(a), self.home

    def close_line(self, station: CubePlacement, way: int, by: CubePlacement | None) -> None:
        """A choice's line is blocked: always, or as long as `by` stands."""
        self._lines.setdefault(station, set()).add((way, by))

    def block(self, leg: TransitEdge, by: CubePlacement | None, time: float | None) -> None:
        """The straight form of a leg is blocked; a way around takes `time` s (inf: there is none; None: unknown)."""
        self._blocked.setdefault((leg.kind, leg.numbers), {})[(*leg.ways, by)] = time

    def forbid(self, leg: TransitEdge, by: CubePlacement | None) -> None:
        """Never use a leg again, or not as long as `by` stands: its way was found and could not be proved as sent."""
        self.block(leg, by, np.inf)
        self._forbidden.add((leg.kind, leg.numbers, (*leg.ways, by)))

    def is_blocked(self, leg: TransitEdge, by: CubePlacement | None) -> bool:
        """Whether that is known already."""
        return (*leg.ways, by) in self._blocked.get((leg.kind, leg.numbers), {})

    def time(self, leg: TransitEdge, by: CubePlacement | None) -> float | None:
        """What a way around is known to take, s; None where none was made yet."""
        return self._blocked[leg.kind, leg.numbers][(*leg.ways, by)]

    def found(self, leg: TransitEdge, by: CubePlacement | None, way: Array) -> bool:
        """Put down what a way around takes; whether that is about what it was taken to take."""
        out, into = self.ends(leg)
        group = (leg.kind, leg.numbers)
        straight = float(leg_times(out, into, self.limits)[0, 0])
        around = path_time(way, self.limits, out.velocity[0], -into.velocity[0])
        time = float(out.time[0] + out.start[0] + around + into.time[0] + into.start[0])
        before = self.time(leg, by)
        assumed = straight + self._assumed_excess(*group, straight) if before is None else before
        self.block(leg, by, time)
        self._excess[group] = min(self._excess.get(group, np.inf), max(time - straight, 0.0))
        return time <= assumed * (1.0 + _NEAR)

    def is_poor(self, leg: TransitEdge) -> bool:
        """Whether ways around between the stations of a leg cost much more than the straight one."""
        out, into = self.ends(leg)
        straight = float(leg_times(out, into, self.limits)[0, 0])
        return self._excess.get((leg.kind, leg.numbers), 0.0) > _POOR * straight

    def ask_again(self) -> None:
        """Forget that there was no way, or no budget, for legs; what is forbidden stays so."""
        for group, known in self._blocked.items():
            for key, cost in known.items():
                if cost in (NOT_NOW, np.inf) and (*group, key) not in self._forbidden:
                    known[key] = None

    def _table(self, times: Callable[[LineEnds, LineEnds, Limits], Array]) -> Table:
        limits = self.limits
        return {
            BEGIN: [[times(self.home, pick, limits)] for pick in self.picks],
            CARRY: [[times(pick, place, limits) for place in self.places] for pick in self.picks],
            GO_ON: [[times(place, pick, limits) for pick in self.picks] for place in self.places],
            END: [[times(place, self.home, limits)] for place in self.places],
        }

    def _costs(
        self, table: Table, changed: Callable[[str, tuple[int, ...], Array, Moment], Array] | None
    ) -> Costs:
        """Times of a table for `plan.program.assignment.sequencing`, changed by what stands where."""

        def begin(pick: int, done: Progress) -> Array:
            time = table[BEGIN][pick][0]
            return np.asarray(
                (time if changed is None else changed(BEGIN, (pick,), time, self.there(done)))[0]
            )

        def carry(pick: int, place: int, done: Progress) -> Array:
            time = table[CARRY][pick][place]
            if changed is None:
                return time
            there = self.there(done)
            time = changed(CARRY, (pick, place), time, there - {CubePlacement(False, pick)})
            after = (there - {CubePlacement(False, pick)}) | {CubePlacement(True, place)}
            closed = (
                self._closed(CubePlacement(False, pick), there),
                self._closed(CubePlacement(True, place), after),
            )
            if not any(closed):
                return time
            time = np.array(time)
            time[closed[0], :], time[:, closed[1]] = np.inf, np.inf
            return time

        def go_on(place: int, pick: int, done: Progress) -> Array:
            if self.options.looks_after(len(done.picks)):
                return np.asarray(end(place, done)[:, None] + begin(pick, done)[None])
            time = table[GO_ON][place][pick]
            return time if changed is None else changed(GO_ON, (place, pick), time, self.there(done))

        def end(place: int, done: Progress) -> Array:
            time = table[END][place][0]
            return np.asarray(
                (time if changed is None else changed(END, (place,), time, self.there(done)))[:, 0]
            )

        return Costs(begin, carry, go_on, end)

    def _with_blocks(self, kind: str, numbers: tuple[int, ...], time: Array, there: Moment) -> Array:
        known = self._blocked.get((kind, numbers))
        if not known:
            return time
        now = np.array(time)
        for (a, b, by), cost in known.items():
            if by is None or by in there:
                straight = float(time[a, b])
                assumed = straight + self._assumed_excess(kind, numbers, straight) if cost is None else cost
                now[a, b] = max(now[a, b], assumed)
        return now

    def _assumed_excess(self, kind: str, numbers: tuple[int, ...], time: float) -> float:
        """What a way around, not made yet, is taken to cost more than the straight one, s."""
        return max(_OVERHEAD * time + _OVERHEAD_S, _ALIKE * self._excess.get((kind, numbers), 0.0))

    def _closed(self, station: CubePlacement, there: Moment) -> list[int]:
        """Choices of a station whose line is blocked."""
        known = self._lines.get(station, set())
        return sorted({way for way, by in known if by is None or by in there})
