"""What the legs of a task are taken to cost: estimates of time, and what was learnt to be in the way.

A leg goes from one choice to another: from the start to a pick, with the cube to a place, from a place to a pick, or to
the end. What is in the way of its straight form may be a cube, and then only counts as long as that stands there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.options import PlanOptions
from plan.program.assignment.leg_times import LineEnds, leg_bounds, leg_times
from plan.program.assignment.sequencing import Costs, Progress
from plan.program.assignment.worlds import CubePlacement
from plan.trajectory.time_estimates import path_time, path_times

# Kinds of legs.
BEGIN, CARRY, GO_ON, END = "begin", "carry", "go on", "end"
# Time of a leg that is not tried for want of budget, s.
NOT_NOW = 1e9
# What a way around is taken to cost at least before one was made, in parts of the straight way and s.
_OVERHEAD, _OVERHEAD_S = 0.02, 0.05
# A way around that takes this much longer than was thought, in parts, is not a reason to ask again.
_NEAR = 0.03
# A way that saves more than this, s, leaves its corners to others.
_NEWS_S = 0.1

Moment = frozenset[CubePlacement]
Table = dict[str, list[list[Array]]]


@dataclass(frozen=True)
class TransitEdge:
    """A way across: its kind, the numbers of pick and place that it joins, and the choice at each end (or 0)."""

    kind: str
    numbers: tuple[int, ...]
    ways: tuple[int, int]


class Detours:
    """Ways around each body: what another one may cost, and where it may begin to be made.

    Ways around the same body are alike, forwards and backwards, with a cube and without. So one that was not made yet
    is taken to go over the corners of one that was, or to take as much longer as they do at the median, whichever is
    less.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._corners: dict[str, list[Array]] = {}
        self.made = 0
        self._excess: dict[tuple[str, bool], list[float]] = {}
        self._median: dict[tuple[str, bool], float] = {}

    def learn(self, body: str, carrying: bool, way: Array, excess: float, over: float) -> None:
        """A way (m, n) rad around `body` was made, which takes `excess` s more than the straight one, and `over` more
        than over corners that were known.
        """
        if over < -_NEWS_S:
            self._corners.setdefault(body, []).extend((way[1:-1], way[-2:0:-1]))
        self.made += 1
        made = self._excess.setdefault((body, carrying), [])
        made.append(excess)
        self._median[body, carrying] = float(np.median(made))

    def known(self, body: str) -> list[Array]:
        """Corners (c, n) rad of ways around a body, in the order in which they were made."""
        return self._corners.get(body, [])

    def median(self, body: str, carrying: bool) -> float:
        """What ways around a body take more than straight ones, s; inf where there are none."""
        return self._median.get((body, carrying), np.inf)

    def over(self, several: Sequence[Array], ends: tuple[LineEnds, LineEnds]) -> Array:
        """Times (k,) s of a leg over each of several corners (c, n)."""
        out, into = ends
        counts = np.array([len(corners) for corners in several])
        times = np.empty(len(several))
        for count in np.unique(counts):
            alike = np.flatnonzero(counts == count)
            paths = np.empty((len(alike), count + 2, out.offset.shape[1]))
            paths[:, 0], paths[:, -1] = out.offset[0], into.offset[0]
            paths[:, 1:-1] = np.stack([several[i] for i in alike.tolist()])
            times[alike] = path_times(paths, self.limits, out.velocity[0], -into.velocity[0])
        return times + float(sum(end.time[0] + end.start[0] for end in ends))

    def nearest(self, body: str, ends: tuple[LineEnds, LineEnds]) -> list[Array]:
        """Corners of ways around a body, those last that are the fastest for a leg."""
        known = self.known(body)
        order = np.argsort(-np.round(self.over(known, ends), 6), kind="stable")
        return [known[i] for i in order.tolist()]


@dataclass
class _Block:
    """What is in the way of a straight leg.

    Attributes:
        body: its name.
        time: of a way around it, s, or None where none was made yet.
        seen, over: how many ways around the body were looked at, and the least time over the corners of one of them, s.
    """

    body: str
    time: float | None
    seen: int = 0
    over: float = np.inf


class _Group:
    """What is known of all legs between the same two stations.

    Attributes:
        blocks: per pair of ways and what is in between.
        forbidden: those of `blocks` that are so for good.
        made: what the best way around what is always there takes more than the straight one, s; inf: none was made.
        clear: whether the straight form of one of them was proved.
    """

    def __init__(self) -> None:
        self.blocks: dict[tuple[int, int, CubePlacement | None], _Block] = {}
        self.forbidden: set[tuple[int, int, CubePlacement | None]] = set()
        self.made, self.clear = np.inf, False
        self.always: tuple[object, Array] | None = (
            None  # times with what is always in the way, and of which state
        )


class TransitCosts:
    """Times of all legs of a task, and what is known to be in their way.

    Args:
        picks, places: the lines of every choice, per pick and per place.
        home: where the task starts and ends.
        limits: that motion is planned under.
        options: which looks are asked for.

    Attributes:
        free: estimates with nothing in the way, per kind and numbers, (ways, ways) s.
        detours: what is known of ways around.
        presume: whether legs that were not looked at are taken to be blocked where all between the same stations are
            that were.
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
        self.detours = Detours(limits)
        self.presume = True
        self._groups: dict[tuple[str, tuple[int, ...]], _Group] = defaultdict(_Group)
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

    def block(self, leg: TransitEdge, by: CubePlacement | None, time: float | None, body: str = "") -> None:
        """The straight form of a leg is blocked by `body`, and a way around takes `time` s.

        inf: there is none; None: none was made yet.
        """
        group = self._of(leg)
        before = group.blocks.get((*leg.ways, by))
        group.blocks[*leg.ways, by] = _Block(body or ("" if before is None else before.body), time)
        group.always = None

    def clear(self, leg: TransitEdge) -> None:
        """The straight form of a leg was proved."""
        group = self._of(leg)
        group.clear, group.always = True, None

    def forbid(self, leg: TransitEdge, by: CubePlacement | None) -> None:
        """Never use a leg again, or not as long as `by` stands: its way was found and could not be proved as sent."""
        self.block(leg, by, np.inf)
        self._of(leg).forbidden.add((*leg.ways, by))

    def is_blocked(self, leg: TransitEdge, by: CubePlacement | None) -> bool:
        """Whether that is known already."""
        return (*leg.ways, by) in self._of(leg).blocks

    def is_known(self, leg: TransitEdge) -> bool:
        """Whether something is known of the legs between the same stations."""
        group = self._of(leg)
        return group.clear or bool(group.blocks)

    def fastest_unknown(self) -> Iterator[TransitEdge]:
        """The fastest leg between any two stations of which `is_known` says nothing."""
        for kind, rows in self.free.items():
            for i, row in enumerate(rows):
                for j, times in enumerate(row):
                    a, b = np.unravel_index(int(np.argmin(np.round(times, 9))), times.shape)
                    leg = TransitEdge(kind, (i, j) if kind in (CARRY, GO_ON) else (i,), (int(a), int(b)))
                    if not self.is_known(leg):
                        yield leg

    def time(self, leg: TransitEdge, by: CubePlacement | None) -> float | None:
        """What a way around is known to take, s; None where none was made yet."""
        return self._of(leg).blocks[*leg.ways, by].time

    def found(self, leg: TransitEdge, by: CubePlacement | None, way: Array) -> bool:
        """Put down what a way around takes; whether that is about what it was taken to take."""
        out, into = self.ends(leg)
        group = self._of(leg)
        block = group.blocks[*leg.ways, by]
        around = path_time(way, self.limits, out.velocity[0], -into.velocity[0])
        time = float(out.time[0] + out.start[0] + around + into.time[0] + into.start[0])
        excess = max(time - float(self._straight(leg.kind, leg.numbers)[leg.ways]), 0.0)
        assumed = block.time
        if assumed is None:
            assumed = self._assumed(leg, block)
            self.detours.learn(block.body, leg.kind == CARRY, way, excess, time - block.over)
        block.time, group.always = time, None
        if by is None:
            group.made = min(group.made, excess)
        return time <= assumed * (1.0 + _NEAR)

    def faster(self, leg: TransitEdge, way: Array, saved: float) -> None:
        """A way around that is known was made faster, by `saved` s."""
        group = self._of(leg)
        group.always = None
        for (a, b, by), block in group.blocks.items():
            if (a, b) == leg.ways and block.time is not None and block.time < NOT_NOW:
                block.time -= saved
                excess = max(block.time - float(self._straight(leg.kind, leg.numbers)[leg.ways]), 0.0)
                self.detours.learn(block.body, leg.kind == CARRY, way, excess, -saved)
                if by is None:
                    group.made = min(group.made, excess)

    def ask_again(self) -> None:
        """Forget that there was no way, or no budget, for legs; what is forbidden stays so."""
        for group in self._groups.values():
            group.always = None
            for key, block in group.blocks.items():
                if block.time in (NOT_NOW, np.inf) and key not in group.forbidden:
                    block.time = None

    def _of(self, leg: TransitEdge) -> _Group:
        return self._groups[leg.kind, leg.numbers]

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
        group = self._groups.get((kind, numbers))
        if group is None or not group.blocks:
            return time
        now = self._always(group, kind, numbers, time)
        changed = False
        for (a, b, by), block in group.blocks.items():
            if by is not None and by in there:
                now, changed = now if changed else np.array(now), True
                now[a, b] = max(now[a, b], self._time(TransitEdge(kind, numbers, (a, b)), block))
        return now

    def _always(self, group: _Group, kind: str, numbers: tuple[int, ...], time: Array) -> Array:
        """Times with what always stands in the way; computed again where something was learnt since."""
        state = self.detours.made, self.presume
        if group.always is None or group.always[0] != state:
            now, least = np.array(time), np.inf
            for (a, b, by), block in group.blocks.items():
                if by is None:
                    now[a, b] = max(time[a, b], self._time(TransitEdge(kind, numbers, (a, b)), block))
                    least = min(least, now[a, b] - time[a, b])
            if self.presume and not group.clear and least < np.inf:
                now = np.maximum(now, time + least)
            group.always = state, now
        return group.always[1]

    def _time(self, leg: TransitEdge, block: _Block) -> float:
        return self._assumed(leg, block) if block.time is None else block.time

    def _assumed(self, leg: TransitEdge, block: _Block) -> float:
        """What a leg is taken to take whose way around was not made yet, s."""
        straight = float(self._straight(leg.kind, leg.numbers)[leg.ways])
        least = straight + _OVERHEAD * straight + _OVERHEAD_S
        known = self.detours.known(block.body)
        if not known:
            return least
        if block.seen < len(known):
            ends = self.ends(leg)
            block.over = min(block.over, float(self.detours.over(known[block.seen :], ends).min()))
            block.seen = len(known)
        alike = self._of(leg).made
        if alike < np.inf:
            return max(least, min(block.over, straight + alike))
        return max(least, min(block.over, straight + self.detours.median(block.body, leg.kind == CARRY)))

    def _straight(self, kind: str, numbers: tuple[int, ...]) -> Array:
        rows = self.free[kind]
        return rows[numbers[0]][numbers[1] if len(numbers) > 1 else 0]

    def _closed(self, station: CubePlacement, there: Moment) -> list[int]:
        """Choices of a station whose line is blocked."""
        known = self._lines.get(station, set())
        return sorted({way for way, by in known if by is None or by in there})
