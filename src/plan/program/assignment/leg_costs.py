"""Costs of the legs of a task: time estimates, raised by what the search has learnt about obstacles.

A leg joins two grasps: from the start to a pick, from a pick with the cube to a place, from a place to a pick, or from
a place to the end. A leg whose straight joint motion is blocked costs as much as a detour. If a cube blocks it, this
holds only while the cube is there.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.options import PlanOptions
from plan.program.assignment.sequencing import Costs, Progress
from plan.program.assignment.worlds import CubePlacement
from plan.program.goals.leg_times import LineEnds, leg_bounds, leg_times
from plan.trajectory.time_estimates import path_time, path_times

# Kinds of legs.
BEGIN, CARRY, GO_ON, END = "begin", "carry", "go on", "end"
# Time of a leg that is excluded because the number of detours is used up, s.
NOT_NOW = 1e9
# Least assumed excess of a detour that was not planned yet: relative to the straight motion, and s.
_OVERHEAD, _OVERHEAD_S = 0.02, 0.05
# Largest relative excess of a detour over its assumed time with which the sequence is kept.
_NEAR = 0.03
# A detour that saves more than this over known corners adds its corners to them, s.
_NEWS_S = 0.1

Moment = frozenset[CubePlacement]
Table = dict[str, list[list[Array]]]


@dataclass(frozen=True)
class TransitEdge:
    """A leg: its kind, the numbers of the pick and place that it joins, and the grasp at each end (or 0)."""

    kind: str
    numbers: tuple[int, ...]
    ways: tuple[int, int]


class Detours:
    """Known detours around each body, from which the cost of other detours is predicted.

    Detours around the same body are similar, in both directions, with a cube and without. So a detour that was not
    planned yet is assumed to pass the corners of a known one, or to have the median excess, whichever is less.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._corners: dict[str, list[Array]] = {}
        self.made = 0
        self._excess: dict[tuple[str, bool], list[float]] = {}
        self._median: dict[tuple[str, bool], float] = {}

    def learn(self, body: str, carrying: bool, way: Array, excess: float, over: float) -> None:
        """Record a detour (m, n) rad around `body`.

        Args:
            excess: its time less that of the straight motion, s.
            over: its time less that over known corners, s.
        """
        if over < -_NEWS_S:
            self._corners.setdefault(body, []).extend((way[1:-1], way[-2:0:-1]))
        self.made += 1
        made = self._excess.setdefault((body, carrying), [])
        made.append(excess)
        self._median[body, carrying] = float(np.median(made))

    def known(self, body: str) -> list[Array]:
        """Return the corners (c, n) rad of detours around a body, in the order in which they were planned."""
        return self._corners.get(body, [])

    def median(self, body: str, carrying: bool) -> float:
        """Return the median excess of detours around a body, s; inf if there are none."""
        return self._median.get((body, carrying), np.inf)

    def over(self, several: Sequence[Array], ends: tuple[LineEnds, LineEnds]) -> Array:
        """Return the times (k,) s of a leg over each of several corner sets (c, n)."""
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
        """Return the corners of detours around a body, those that are fastest for a leg last."""
        known = self.known(body)
        order = np.argsort(-np.round(self.over(known, ends), 6), kind="stable")
        return [known[i] for i in order.tolist()]


@dataclass
class _Block:
    """What blocks the straight motion of a leg.

    Attributes:
        body: name of the body.
        time: time of a detour, s; None if none was planned yet.
        seen, over: number of known detours compared so far, and the least time of the leg over their corners, s.
    """

    body: str
    time: float | None
    seen: int = 0
    over: float = np.inf


class _Group:
    """What is known about all legs between the same two stations.

    Attributes:
        blocks: blocked legs, by the grasps at both ends and the blocking cube (None: a fixed body).
        forbidden: those of `blocks` that are excluded for good.
        made: least excess of a detour around a fixed body, s; inf if none was planned.
        clear: whether a straight motion between the two stations was certified.
    """

    def __init__(self) -> None:
        self.blocks: dict[tuple[int, int, CubePlacement | None], _Block] = {}
        self.forbidden: set[tuple[int, int, CubePlacement | None]] = set()
        self.made, self.clear = np.inf, False
        self.always: tuple[object, Array] | None = (
            None  # times with fixed bodies in the way, and the state that they were computed for
        )


class TransitCosts:
    """Times of all legs of a task, with what is known to block them.

    Args:
        picks, places: the lines of every grasp, for each pick and each place.
        home: start and end of the task.
        limits: limits for planning.
        options: after which cubes images are taken.

    Attributes:
        free: obstacle-free estimates by kind and numbers, (ways, ways) s.
        detours: known detours.
        presume: whether a leg that was not checked is assumed to be blocked if all checked ones between the same
            stations are.
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
        """Return the estimates with all known obstacles."""
        return self._costs(self.free, self._with_blocks)

    def bounds(self) -> Costs:
        """Return the lower bounds, without obstacles."""
        return self._costs(self._table(leg_bounds), None)

    def there(self, done: Progress) -> Moment:
        """Return the placements of the cubes after some progress."""
        left = (CubePlacement(False, i) for i in range(len(self.picks)) if i not in done.picks)
        return frozenset(left) | frozenset(CubePlacement(True, j) for j in done.places)

    def ends(self, leg: TransitEdge) -> tuple[LineEnds, LineEnds]:
        """Return the two ends of a leg, one row each."""
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
        """Record that the line of a grasp is blocked: always, or while the cube `by` is there."""
        self._lines.setdefault(station, set()).add((way, by))

    def block(self, leg: TransitEdge, by: CubePlacement | None, time: float | None, body: str = "") -> None:
        """Record that `body` blocks the straight motion of a leg, and that a detour takes `time` s.

        inf: no detour was found; None: none was planned yet.
        """
        group = self._of(leg)
        before = group.blocks.get((*leg.ways, by))
        group.blocks[*leg.ways, by] = _Block(body or ("" if before is None else before.body), time)
        group.always = None

    def clear(self, leg: TransitEdge) -> None:
        """Record that the straight motion of a leg was certified."""
        group = self._of(leg)
        group.clear, group.always = True, None

    def forbid(self, leg: TransitEdge, by: CubePlacement | None) -> None:
        """Exclude a leg, or while the cube `by` is there: its path could not be certified as sent."""
        self.block(leg, by, np.inf)
        self._of(leg).forbidden.add((*leg.ways, by))

    def is_blocked(self, leg: TransitEdge, by: CubePlacement | None) -> bool:
        """Return whether the leg is known to be blocked by that cube (None: a fixed body)."""
        return (*leg.ways, by) in self._of(leg).blocks

    def is_known(self, leg: TransitEdge) -> bool:
        """Return whether a leg between the same stations was checked."""
        group = self._of(leg)
        return group.clear or bool(group.blocks)

    def fastest_unknown(self) -> Iterator[TransitEdge]:
        """Yield the fastest leg between each two stations without a checked leg."""
        for kind, rows in self.free.items():
            for i, row in enumerate(rows):
                for j, times in enumerate(row):
                    a, b = np.unravel_index(int(np.argmin(np.round(times, 9))), times.shape)
                    leg = TransitEdge(kind, (i, j) if kind in (CARRY, GO_ON) else (i,), (int(a), int(b)))
                    if not self.is_known(leg):
                        yield leg

    def time(self, leg: TransitEdge, by: CubePlacement | None) -> float | None:
        """Return the time of the known detour, s; None if none was planned yet."""
        return self._of(leg).blocks[*leg.ways, by].time

    def found(self, leg: TransitEdge, by: CubePlacement | None, way: Array) -> bool:
        """Record the time of a detour; return whether it is about the assumed time."""
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
        """Record that a known detour was made faster by `saved` s."""
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
        """Forget failed and postponed detours; excluded legs stay excluded."""
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
        """Return the times of a table for `plan.program.assignment.sequencing`, changed by the cubes' placements."""

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
        """Return the times with fixed obstacles; they are computed again after something was learnt."""
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
        """Return the assumed time of a leg whose detour was not planned yet, s."""
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
        """Return the grasps of a station whose line is blocked."""
        known = self._lines.get(station, set())
        return sorted({way for way, by in known if by is None or by in there})
