"""Order, place and grasp of each cube with the least sum of given leg times.

A task alternates between picks and places: start, pick, place, pick, place, .., end. Each pick and place has several
grasps (yaw and branch); a *way* is the number of a grasp. With few cubes, dynamic programming over the picks done and
the places filled is exact (M. Held, R. Karp, "A dynamic programming approach to sequencing problems", 1962). With many
cubes, exchanges improve one order, and `order_bound` gives a lower bound.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import comb

import numpy as np
from scipy.optimize import linear_sum_assignment

from arm.se3 import Array
from plan.program.assignment.order_bound import LegTimes, order_bound

# Largest number of expansions for which dynamic programming is used.
_MOST_STATES = 1500
_TIE = 1e-9
# Finite substitute for an infinite time, s, so that orders with fewer impossible legs rank better.
_BLOCKED = 1e10

Pairs = list[tuple[int, int]]  # pick and place, in order


@dataclass(frozen=True)
class Visit:
    """One cube: its pick and place, and the grasp at each."""

    pick: int
    place: int
    pick_way: int
    place_way: int


@dataclass(frozen=True)
class Progress:
    """Progress before a step: picks that are done, and places that are filled."""

    picks: frozenset[int]
    places: frozenset[int]


@dataclass(frozen=True)
class Costs:
    """Times of the legs, s; they may depend on the progress, because cubes may be obstacles.

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
    """Choices of a task.

    Attributes:
        picks, places: their numbers; there are at least as many places as picks.
        order: whether the order of the picks is free; otherwise it is that of their numbers.
        assignment: whether a cube may go to any place; otherwise it goes to the place of its own number.
    """

    picks: int
    places: int
    order: bool = True
    assignment: bool = True

    def next_picks(self, done: frozenset[int]) -> Iterator[int]:
        """Yield the picks that may be next."""
        left = (i for i in range(self.picks) if i not in done)
        return left if self.order else iter(list(left)[:1])

    def places_of(self, pick: int, filled: frozenset[int]) -> Iterator[int]:
        """Yield the places where a pick's cube may go."""
        every = range(self.places) if self.assignment else (pick,)
        return (j for j in every if j not in filled)

    @property
    def exact(self) -> bool:
        """Whether dynamic programming covers all orders and assignments."""
        return self.states() <= _MOST_STATES

    def states(self) -> int:
        """Return the approximate number of expansions of dynamic programming."""
        total = 0
        for k in range(self.picks):
            filled = comb(self.places, k) if self.assignment else 1
            total += filled * (comb(self.picks, k) * (self.picks - k) if self.order else 1)
        return total


@dataclass(frozen=True)
class Ordered:
    """Visits in order, and their time, s."""

    visits: tuple[Visit, ...]
    time: float


def best_order(freedom: Choices, costs: Costs) -> Ordered | None:
    """Return the visits with the least sum of times; None if all sums are infinite."""
    if freedom.exact:
        return _exactly(freedom, costs)
    return _improved(freedom, costs)


@dataclass(frozen=True, eq=False)
class _Node:
    """Least times to reach a pick or place after some progress, with back pointers.

    Attributes:
        at: number of the pick or place.
        time: (ways,) s.
        before, way: for each way, the previous node and the way there.
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
    return Ordered(_traced(best), time)


def _to_pick(pick: int, done: Progress, places: dict[int, _Node], costs: Costs, first: bool) -> _Node | None:
    if first:
        time = costs.begin(pick, done)
        return _Node(pick, time, (None,) * len(time), (0,) * len(time))
    ways = [(node, node.time[:, None] + costs.go_on(place, pick, done)) for place, node in places.items()]
    return _reached(pick, ways) if ways else None


def _reached(at: int, ways: Sequence[tuple[_Node, Array]]) -> _Node:
    """Return the node of a place that is reached from other nodes, with times (ways there, ways here)."""
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
    """Return the best grasps for a given order and assignment, as pairs of pick and place; None if all are infinite."""
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
    return Ordered(_traced(end), time) if np.isfinite(time) else None


def lower_bound(freedom: Choices, costs: Costs, ordered: Ordered | None) -> float:
    """Return a lower bound over all choices, s, given the result of `best_order` for the same times.

    If exchanges were used, it holds if a leg's time depends on the progress only by the number of cubes moved.
    """
    if ordered is None or freedom.exact:
        return np.inf if ordered is None else ordered.time
    return order_bound(_least_times(freedom, _finite(costs)), ordered.time)


def _improved(freedom: Choices, costs: Costs) -> Ordered | None:
    """Improve an order by exchanges, from the assignment with the shortest carries."""
    costs = _finite(costs)
    legs = _least_times(freedom, costs)
    best: Ordered | None = None
    for first in _firsts(freedom, legs):
        found = _exchanged(_chained(first, freedom, legs), freedom, costs, legs)
        if found is not None and (best is None or found.time < best.time - 1e-6):
            best = found
        if best is not None and best.time < _BLOCKED:
            return best
    return None


def _exchanged(pairs: Pairs, freedom: Choices, costs: Costs, legs: LegTimes) -> Ordered | None:
    """Return the visits after all exchanges that save time."""
    best = best_grasps(pairs, costs)
    improving = best is not None
    while improving:
        improving = False
        for trial in _exchanges(pairs, freedom):
            # the sum of the least leg times is a lower bound
            if best is None or _least_time(trial, legs) >= best.time - 1e-6:
                continue
            found = best_grasps(trial, costs)
            if found is not None and found.time < best.time - 1e-6:
                best, pairs, improving = found, trial, True
                break
    return best


def _finite(costs: Costs) -> Costs:
    """Return the same times, with `_BLOCKED` in place of infinite ones."""

    def capped(time: Array) -> Array:
        return np.minimum(time, _BLOCKED)

    return Costs(
        lambda pick, done: capped(costs.begin(pick, done)),
        lambda pick, place, done: capped(costs.carry(pick, place, done)),
        lambda place, pick, done: capped(costs.go_on(place, pick, done)),
        lambda place, done: capped(costs.end(place, done)),
    )


def _least_times(freedom: Choices, costs: Costs) -> LegTimes:
    """Return the least times of each leg over all grasps, without other cubes in the way; they rank and bound orders.

    Whether the arm goes home between two cubes depends on the number of cubes moved.
    """
    n, m = freedom.picks, freedom.places
    nothing: frozenset[int] = frozenset()
    every = frozenset(range(n))
    carry, go_on = np.full((n, m), _BLOCKED), np.full((n, m, n), _BLOCKED)
    for i in range(n):
        for j in freedom.places_of(i, nothing):
            carry[i, j] = costs.carry(i, j, Progress(every - {i}, nothing)).min()
        others = [k for k in range(n) if k != i]
        for count in range(1, n):
            if freedom.order or count == i:
                done = [Progress(frozenset(others[:count]), frozenset((j,))) for j in range(m)]
                go_on[count, :, i] = [costs.go_on(j, i, d).min() for j, d in enumerate(done)]
    begin = [costs.begin(i, Progress(nothing, nothing)).min() for i in range(n)]
    if not freedom.order:
        begin[1:] = [_BLOCKED] * (n - 1)
    end = [costs.end(j, Progress(every, frozenset((j,)))).min() for j in range(m)]
    return LegTimes(np.array(begin), carry, go_on, np.array(end))


def _least_time(pairs: Sequence[tuple[int, int]], legs: LegTimes) -> float:
    """Return the sum of the least leg times of an order and assignment, s."""
    times = [legs.begin[pairs[0][0]], *(legs.carry[pair] for pair in pairs), legs.end[pairs[-1][1]]]
    times += [legs.go_on[k, a[1], b[0]] for k, (a, b) in enumerate(pairwise(pairs), start=1)]
    return float(sum(times))


def _firsts(freedom: Choices, legs: LegTimes) -> list[int]:
    """Return the possible first picks, the nearest first."""
    if not freedom.order:
        return [0]
    return sorted(range(freedom.picks), key=lambda i: (round(float(legs.begin[i]), 6), i))


def _chained(first: int, freedom: Choices, legs: LegTimes) -> Pairs:
    """Return the assignment with the shortest carries, in the order of the nearest next pick."""
    _, place_of = linear_sum_assignment(np.round(legs.carry, 6))
    left = set(range(freedom.picks)) - {first}
    pairs = [(first, int(place_of[first]))]
    while left:
        onward = legs.go_on[len(pairs), pairs[-1][1]]
        pick = min(left, key=lambda i: (round(float(onward[i]), 6), i))
        left.remove(pick)
        pairs.append((pick, int(place_of[pick])))
    return pairs


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
