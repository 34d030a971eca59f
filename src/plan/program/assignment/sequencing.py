"""In which order, to which place, and in which way each cube goes: the least sum of given times, exactly.

A task alternates between picks and places: start, pick, place, pick, place, .., end. Each pick and place can be served
in several ways (yaw and branch). With few cubes all orders and assignments are covered by dynamic programming over
which picks are done and which places are filled (M. Held, R. Karp, "A dynamic programming approach to sequencing
problems", 1962). With many, one order is improved by exchanges, and what no order can undercut is bounded by two
assignment problems, one over the carries and one over the ways back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import comb

import numpy as np
from scipy.optimize import linear_sum_assignment

from arm.se3 import Array

# Dynamic programming is used up to about this many sets of picks and places, times the pairs to go on with.
_MOST_STATES = 1500
_TIE = 1e-9
# What an infinite time counts in sums that are compared, s: an order with fewer legs that cannot be is still better.
_BLOCKED = 1e10


@dataclass(frozen=True)
class Visit:
    """One cube: from which pick to which place, and in which way at each."""

    pick: int
    place: int
    pick_way: int
    place_way: int


@dataclass(frozen=True)
class Progress:
    """What was done before a step: picks that are empty now, and places that are filled."""

    picks: frozenset[int]
    places: frozenset[int]


@dataclass(frozen=True)
class Costs:
    """Times of the legs, s; may depend on what was done before (what stands in the way).

    Attributes:
        begin: (pick, done) -> (ways,) from the start.
        carry: (pick, place, done) -> (pick ways, place ways).
        go_on: (place, pick, done) -> (place ways, pick ways); `done` includes the place.
        end: (place, done) -> (ways,) to the end.
    """

    begin: Callable[[int, Progress], Array]
    carry: Callable[[int, int, Progress], Array]
    go_on: Callable[[int, int, Progress], Array]
    end: Callable[[int, Progress], Array]


@dataclass(frozen=True)
class Choices:
    """What may be chosen.

    Attributes:
        picks, places: how many there are; at least as many places as picks.
        order: whether the picks may be served in any order, or in that of their numbers.
        assignment: whether a pick may go to any place, or to that of the same number only.
    """

    picks: int
    places: int
    order: bool = True
    assignment: bool = True

    def next_picks(self, done: frozenset[int]) -> Iterator[int]:
        """Picks that may be served next."""
        left = (i for i in range(self.picks) if i not in done)
        return left if self.order else iter(list(left)[:1])

    def places_of(self, pick: int, filled: frozenset[int]) -> Iterator[int]:
        """Places where a pick's cube may go."""
        every = range(self.places) if self.assignment else (pick,)
        return (j for j in every if j not in filled)

    @property
    def exact(self) -> bool:
        """Whether dynamic programming covers all orders and assignments."""
        return self.states() <= _MOST_STATES

    def states(self) -> int:
        """How many expansions dynamic programming would make, roughly."""
        total = 0
        for k in range(self.picks):
            filled = comb(self.places, k) if self.assignment else 1
            total += filled * (comb(self.picks, k) * (self.picks - k) if self.order else 1)
        return total


@dataclass(frozen=True)
class Ordered:
    """Visits in order, their time, and a bound that no other choice undercuts, s.

    Where exchanges were used, the bound holds if a leg's time depends on no more than how many cubes were moved before.
    """

    visits: tuple[Visit, ...]
    time: float
    bound: float


def best_order(freedom: Choices, costs: Costs) -> Ordered | None:
    """The visits with the least sum of times, or None where every one is infinite."""
    if freedom.exact:
        return _exactly(freedom, costs)
    return _improved(freedom, costs)


@dataclass(frozen=True, eq=False)
class _Node:
    """Least times to be somewhere after something, and how that was reached.

    Attributes:
        at: number of the pick or place.
        time: (ways,) s.
        before: per way, the node before; `way` the way there.
    """

    at: int
    time: Array
    before: tuple[_Node | None, ...]
    way: tuple[int, ...]


def _exactly(freedom: Choices, costs: Costs) -> Ordered | None:
    nothing = Progress(frozenset(), frozenset())
    layer: dict[Progress, dict[int, _Node]] = {nothing: {}}
    for count in range(freedom.picks):
        following: dict[Progress, dict[int, _Node]] = {}
        for done, places in layer.items():
            for pick in freedom.next_picks(done.picks):
                over = _to_pick(pick, done, places, costs, first=count == 0)
                if over is None:
                    continue
                for place in freedom.places_of(pick, done.places):
                    carried = over.time[:, None] + costs.carry(pick, place, done)
                    after = Progress(done.picks | {pick}, done.places | {place})
                    node = _reached(place, [(over, carried)])
                    known = following.setdefault(after, {})
                    known[place] = _better(known.get(place), node)
        layer = following
    ends = [
        _reached(-1, [(node, (node.time + costs.end(place, done))[:, None])])
        for done, places in layer.items()
        for place, node in places.items()
    ]
    finite = [node for node in ends if np.isfinite(node.time[0])]
    if not finite:
        return None
    best = min(finite, key=lambda node: round(float(node.time[0]), 9))
    time = float(best.time[0])
    return Ordered(_traced(best), time, time)


def _to_pick(pick: int, done: Progress, places: dict[int, _Node], costs: Costs, first: bool) -> _Node | None:
    if first:
        time = costs.begin(pick, done)
        return _Node(pick, time, (None,) * len(time), (0,) * len(time))
    ways = [(node, node.time[:, None] + costs.go_on(place, pick, done)) for place, node in places.items()]
    return _reached(pick, ways) if ways else None


def _reached(at: int, ways: Sequence[tuple[_Node, Array]]) -> _Node:
    """A place reached from nodes with times (ways there, ways here)."""
    times = np.concatenate([time for _, time in ways])
    from_node = [(node, way) for node, time in ways for way in range(len(time))]
    best = np.argmin(np.round(times, 9), axis=0)
    origin = [from_node[b] for b in best.tolist()]
    return _Node(
        at, times[best, np.arange(times.shape[1])], tuple(n for n, _ in origin), tuple(w for _, w in origin)
    )


def _better(known: _Node | None, node: _Node) -> _Node:
    if known is None:
        return node
    keep = known.time <= node.time + _TIE
    return _Node(
        node.at,
        np.where(keep, known.time, node.time),
        tuple(a if k else b for k, a, b in zip(keep, known.before, node.before, strict=True)),
        tuple(a if k else b for k, a, b in zip(keep, known.way, node.way, strict=True)),
    )


def _traced(end: _Node) -> tuple[Visit, ...]:
    stops: list[tuple[int, int]] = []
    node, way = end.before[0], end.way[0]
    while node is not None:
        stops.append((node.at, way))
        before, way_before = node.before[way], node.way[way]
        node, way = before, way_before
    stops.reverse()
    return tuple(
        Visit(pick, place, pick_way, place_way)
        for (pick, pick_way), (place, place_way) in zip(stops[::2], stops[1::2], strict=True)
    )


def best_grasps(pairs: Sequence[tuple[int, int]], costs: Costs) -> Ordered | None:
    """The best ways for a given order and assignment: pairs of pick and place; None where all are infinite."""
    done = Progress(frozenset(), frozenset())
    node: _Node | None = None
    for pick, place in pairs:
        over = _to_pick(pick, done, {} if node is None else {node.at: node}, costs, first=node is None)
        if over is None:
            return None
        node = _reached(place, [(over, over.time[:, None] + costs.carry(pick, place, done))])
        done = Progress(done.picks | {pick}, done.places | {place})
    if node is None:
        return None
    end = _reached(-1, [(node, (node.time + costs.end(node.at, done))[:, None])])
    time = float(end.time[0])
    return Ordered(_traced(end), time, time) if np.isfinite(time) else None


def _improved(freedom: Choices, costs: Costs) -> Ordered | None:
    """Exchanges of order and places, from the assignment with the shortest carries."""
    costs = _finite(costs)
    table = _Least(freedom, costs)
    best: Ordered | None = None
    for first in table.firsts():
        found = _exchanged(table.chained(first), freedom, costs, table)
        if found is not None and (best is None or found.time < best.time - 1e-6):
            best = found
        if best is not None and best.time < _BLOCKED:
            return Ordered(best.visits, best.time, min(table.bound(), best.time))
    return None


def _exchanged(pairs: list[tuple[int, int]], freedom: Choices, costs: Costs, table: _Least) -> Ordered | None:
    """Order and places after every exchange that helps."""
    best = best_grasps(pairs, costs)
    improving = best is not None
    while improving:
        improving = False
        for trial in _exchanges(pairs, freedom):
            # the table has every leg at its best: what it finds too slow is
            if best is None or table.time(trial) >= best.time - 1e-6:
                continue
            found = best_grasps(trial, costs)
            if found is not None and found.time < best.time - 1e-6:
                best, pairs, improving = found, trial, True
                break
    return best


def _finite(costs: Costs) -> Costs:
    """The same times, with `_BLOCKED` for infinite ones."""

    def capped(time: Array) -> Array:
        return np.minimum(time, _BLOCKED)

    return Costs(
        lambda pick, done: capped(costs.begin(pick, done)),
        lambda pick, place, done: capped(costs.carry(pick, place, done)),
        lambda place, pick, done: capped(costs.go_on(place, pick, done)),
        lambda place, done: capped(costs.end(place, done)),
    )


class _Least:
    """Least times of each leg over all ways, with no other cube in the way: what ranks orders, and bounds them."""

    def __init__(self, freedom: Choices, costs: Costs) -> None:
        self.freedom = freedom
        picks, places = range(freedom.picks), range(freedom.places)
        nothing: frozenset[int] = frozenset()
        every = frozenset(picks)
        self.begin = np.array([costs.begin(i, Progress(nothing, nothing)).min() for i in picks])
        self.carry = np.array(
            [
                [
                    costs.carry(i, j, Progress(every - {i}, nothing)).min()
                    if freedom.assignment or i == j
                    else _BLOCKED
                    for j in places
                ]
                for i in picks
            ]
        )
        # whether the arm goes home between two cubes depends on how many were moved
        self.go_on = np.array(
            [[min(costs.go_on(j, i, d).min() for d in self._before(i, j)) for i in picks] for j in places]
        )
        self.end = np.array([costs.end(j, Progress(every, frozenset((j,)))).min() for j in places])

    def _before(self, pick: int, place: int) -> Iterator[Progress]:
        """One case for each number of cubes that may have been moved when `place` is left for `pick`."""
        others = [i for i in range(self.freedom.picks) if i != pick]
        for count in range(1, len(others) + 1):
            yield Progress(frozenset(others[:count]), frozenset((place,)))

    def time(self, pairs: Sequence[tuple[int, int]]) -> float:
        total = self.begin[pairs[0][0]] + self.end[pairs[-1][1]]
        total += sum(self.carry[i, j] for i, j in pairs)
        return float(total + sum(self.go_on[a[1], b[0]] for a, b in pairwise(pairs)))

    def firsts(self) -> list[int]:
        """Picks to begin with, the nearest first."""
        if not self.freedom.order:
            return [0]
        return sorted(range(self.freedom.picks), key=lambda i: (round(float(self.begin[i]), 6), i))

    def chained(self, first: int) -> list[tuple[int, int]]:
        """The assignment with the shortest carries, each time on to the nearest pick."""
        _, place_of = linear_sum_assignment(np.round(self.carry, 6))
        left = set(range(self.freedom.picks)) - {first}
        pairs = [(first, int(place_of[first]))]
        while left:
            if not self.freedom.order:
                pick = min(left)
            else:
                pick = min(left, key=lambda i: (round(float(self.go_on[pairs[-1][1], i]), 6), i))
            left.remove(pick)
            pairs.append((pick, int(place_of[pick])))
        return pairs

    def bound(self) -> float:
        """No order and assignment take less: shortest carries, and shortest ways to all picks and to the end."""
        n, m = self.freedom.picks, self.freedom.places
        rows, columns = linear_sum_assignment(self.carry)
        # every pick is come to from the start or from a place, and the end from a place, each left once
        ways = np.full((m + 1, n + 1), _BLOCKED)
        ways[0, :n], ways[1:, :n], ways[1:, n] = self.begin, self.go_on, self.end
        back_rows, back_columns = linear_sum_assignment(ways)
        return float(self.carry[rows, columns].sum() + ways[back_rows, back_columns].sum())


def _exchanges(pairs: Sequence[tuple[int, int]], freedom: Choices) -> Iterator[list[tuple[int, int]]]:
    if freedom.assignment:
        for a, b in combinations(range(len(pairs)), 2):
            trial = list(pairs)
            trial[a], trial[b] = (pairs[a][0], pairs[b][1]), (pairs[b][0], pairs[a][1])
            yield trial
        spare = [j for j in range(freedom.places) if j not in {place for _, place in pairs}]
        for a in range(len(pairs)):
            for place in spare:
                trial = list(pairs)
                trial[a] = (pairs[a][0], place)
                yield trial
    if freedom.order:
        for a, b in combinations(range(len(pairs)), 2):
            trial = list(pairs)
            trial[a], trial[b] = pairs[b], pairs[a]
            yield trial
            yield [*pairs[:a], *reversed(pairs[a : b + 1]), *pairs[b + 1 :]]
            moved = list(pairs)
            moved.insert(b, moved.pop(a))
            yield moved
