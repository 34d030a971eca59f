"""Order, place and grasp of each cube with the least sum of given leg times.

A task alternates between sources and places: home, source, place, source, place, .., home. Each site has several grasps
(yaw and branch). With few cubes, dynamic programming over the arrangements is exact (M. Held, R. Karp, "A dynamic
programming approach to sequencing problems", 1962). With many cubes, exchanges improve one order, and `order_bound`
gives a lower bound.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from math import comb

import numpy as np
from scipy.optimize import linear_sum_assignment

from arm.se3 import Array
from plan.program.assignment.legs import HOME, Arrangement, Site, Stop
from plan.program.assignment.order_bound import LegTimes, order_bound

# Largest number of expansions for which dynamic programming is used.
_MOST_STATES = 1500
_TIE, _TIES = 1e-9, 1e9  # s, and 1/s
# Finite substitute for an infinite time, s, so that orders with fewer impossible legs rank better.
_BLOCKED = 1e10

Pairs = list[tuple[int, int]]  # numbers of the source and the place of each cube, in order

# Times (grasps, grasps) s of the leg from one site to another while cubes rest in some arrangement, which may be
# obstacles.
Costs = Callable[[Site, Site, Arrangement], Array]


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

    @property
    def start(self) -> Arrangement:
        """The arrangement at the start."""
        return frozenset(Site(False, i) for i in range(self.picks))

    def next_picks(self, there: Arrangement) -> list[int]:
        """Return the numbers of the cubes that may be next."""
        left = [i for i in range(self.picks) if Site(False, i) in there]
        return left if self.order else left[:1]

    def places_of(self, pick: int, there: Arrangement) -> list[int]:
        """Return the numbers of the places where a cube may go."""
        every = range(self.places) if self.assignment else (pick,)
        return [j for j in every if Site(True, j) not in there]

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
    """A sequence: its stops, source and place of each cube in turn, and its time, s; inf if a leg is impossible."""

    stops: tuple[Stop, ...]
    time: float

    @property
    def pairs(self) -> Pairs:
        """Numbers of the source and the place of each cube, in order."""
        numbers = [stop.site.number for stop in self.stops]
        return list(zip(numbers[::2], numbers[1::2], strict=True))


def best_order(choices: Choices, costs: Costs) -> Ordered:
    """Return the sequence with the least sum of times."""
    return _exactly(choices, costs) if choices.exact else _improved(choices, costs)


@dataclass(frozen=True, eq=False)
class _Node:
    """Least times to reach a site in some arrangement, with back pointers.

    Attributes:
        site: the site.
        time: (grasps,) s.
        before: for each grasp, the previous node and the grasp there.
    """

    site: Site
    time: Array
    before: tuple[tuple[_Node, int], ...]

    def traced(self) -> Ordered:
        """Return the fastest sequence that ends here."""
        stops: list[Stop] = []
        node, grasp = self.before[0]
        while node.site != HOME:
            stops.append(Stop(node.site, grasp))
            node, grasp = node.before[grasp]
        return Ordered(tuple(reversed(stops)), float(self.time[0]))


_START = _Node(HOME, np.zeros(1), ())


def _exactly(choices: Choices, costs: Costs) -> Ordered:
    layer: dict[Arrangement, dict[Site, _Node]] = {choices.start: {HOME: _START}}
    for _ in range(choices.picks):
        following: dict[Arrangement, dict[Site, _Node]] = {}
        for there, nodes in layer.items():
            for pick in choices.next_picks(there):
                source, carrying = Site(False, pick), there - {Site(False, pick)}
                taken = _reached(source, nodes.values(), costs, there)
                for j in choices.places_of(pick, there):
                    place = Site(True, j)
                    node = _reached(place, [taken], costs, carrying)
                    known = following.setdefault(carrying | {place}, {})
                    known[place] = _better(known.get(place), node)
        layer = following
    ends = [_reached(HOME, [node], costs, there) for there, nodes in layer.items() for node in nodes.values()]
    return min(ends, key=lambda node: round(float(node.time[0]), 9)).traced()


def _reached(site: Site, origins: Collection[_Node], costs: Costs, there: Arrangement) -> _Node:
    """Return the node of a site that is reached from other nodes."""
    times = [node.time[:, None] + costs(node.site, site, there) for node in origins]
    every = times[0] if len(times) == 1 else np.concatenate(times)
    best = np.rint(every * _TIES).argmin(axis=0)
    before = [(node, grasp) for node, time in zip(origins, times, strict=True) for grasp in range(len(time))]
    return _Node(site, every[best, np.arange(every.shape[1])], tuple(before[b] for b in best.tolist()))


def _better(known: _Node | None, node: _Node) -> _Node:
    """Return the faster of two nodes of a site, for each grasp."""
    if known is None:
        return node
    keep = known.time <= node.time + _TIE
    before = tuple(a if k else b for k, a, b in zip(keep, known.before, node.before, strict=True))
    return _Node(node.site, np.where(keep, known.time, node.time), before)


def best_grasps(pairs: Sequence[tuple[int, int]], costs: Costs) -> Ordered:
    """Return the sequence with the best grasps for a given order and assignment."""
    there: Arrangement = frozenset(Site(False, pick) for pick, _ in pairs)
    node = _START
    for pick, j in pairs:
        source, place = Site(False, pick), Site(True, j)
        taken = _reached(source, [node], costs, there)
        there -= {source}
        node = _reached(place, [taken], costs, there)
        there |= {place}
    return _reached(HOME, [node], costs, there).traced()


def lower_bound(choices: Choices, costs: Costs, ordered: Ordered) -> float:
    """Return a lower bound over all choices, s, given the result of `best_order` for the same times.

    If exchanges were used, it holds if a leg's time depends on the progress only by the number of cubes moved.
    """
    if choices.exact or np.isinf(ordered.time):
        return ordered.time
    return order_bound(_least_times(choices, _finite(costs)), ordered.time)


def _improved(choices: Choices, costs: Costs) -> Ordered:
    """Improve an order by exchanges, from the assignment with the shortest carries."""
    costs = _finite(costs)
    legs = _least_times(choices, costs)
    for first in _firsts(choices, legs):
        found = _exchanged(_chained(first, choices, legs), choices, costs, legs)
        if found.time < _BLOCKED:
            return found
    return Ordered((), np.inf)


def _exchanged(pairs: Pairs, choices: Choices, costs: Costs, legs: LegTimes) -> Ordered:
    """Return the sequence after all exchanges that save time."""
    best, improving = best_grasps(pairs, costs), True
    while improving:
        improving = False
        for trial in _exchanges(pairs, choices):
            # the sum of the least leg times is a lower bound
            if _least_time(trial, legs) >= best.time - 1e-6:
                continue
            found = best_grasps(trial, costs)
            if found.time < best.time - 1e-6:
                best, pairs, improving = found, trial, True
                break
    return best


def _finite(costs: Costs) -> Costs:
    """Return the same times, with `_BLOCKED` in place of infinite ones."""
    return lambda origin, goal, there: np.minimum(costs(origin, goal, there), _BLOCKED)


def _least_times(choices: Choices, costs: Costs) -> LegTimes:
    """Return the least times of each leg over all grasps, without other cubes in the way; they rank and bound orders.

    Whether the arm goes home between two cubes depends on the number of cubes moved.
    """
    n, m = choices.picks, choices.places
    sources, places = ([Site(placed, k) for k in range(count)] for placed, count in ((False, n), (True, m)))
    carry, go_on = np.full((n, m), _BLOCKED), np.full((n, m, n), _BLOCKED)
    for i, source in enumerate(sources):
        for j in choices.places_of(i, frozenset()):
            carry[i, j] = costs(source, places[j], frozenset()).min()
        others = [k for k in sources if k != source]
        for count in range(1, n):
            if choices.order or count == i:
                left = frozenset((source, *others[count:]))
                go_on[count, :, i] = [costs(place, source, left | {place}).min() for place in places]
    begin = [costs(HOME, source, choices.start).min() for source in sources]
    if not choices.order:
        begin[1:] = [_BLOCKED] * (n - 1)
    end = [costs(place, HOME, frozenset((place,))).min() for place in places]
    return LegTimes(np.array(begin), carry, go_on, np.array(end))


def _least_time(pairs: Sequence[tuple[int, int]], legs: LegTimes) -> float:
    """Return the sum of the least leg times of an order and assignment, s."""
    times = [legs.begin[pairs[0][0]], *(legs.carry[pair] for pair in pairs), legs.end[pairs[-1][1]]]
    times += [legs.go_on[k, a[1], b[0]] for k, (a, b) in enumerate(pairwise(pairs), start=1)]
    return float(sum(times))


def _firsts(choices: Choices, legs: LegTimes) -> list[int]:
    """Return the possible first picks, the nearest first."""
    if not choices.order:
        return [0]
    return sorted(range(choices.picks), key=lambda i: (round(float(legs.begin[i]), 6), i))


def _chained(first: int, choices: Choices, legs: LegTimes) -> Pairs:
    """Return the assignment with the shortest carries, in the order of the nearest next pick."""
    _, place_of = linear_sum_assignment(np.round(legs.carry, 6))
    left = set(range(choices.picks)) - {first}
    pairs = [(first, int(place_of[first]))]
    while left:
        onward = legs.go_on[len(pairs), pairs[-1][1]]
        pick = min(left, key=lambda i: (round(float(onward[i]), 6), i))
        left.remove(pick)
        pairs.append((pick, int(place_of[pick])))
    return pairs


def _exchanges(pairs: Sequence[tuple[int, int]], choices: Choices) -> Iterator[list[tuple[int, int]]]:
    if choices.assignment:
        for a, b in combinations(range(len(pairs)), 2):
            trial = list(pairs)
            trial[a], trial[b] = (pairs[a][0], pairs[b][1]), (pairs[b][0], pairs[a][1])
            yield trial
        spare = [j for j in range(choices.places) if j not in {place for _, place in pairs}]
        for a in range(len(pairs)):
            for place in spare:
                trial = list(pairs)
                trial[a] = (pairs[a][0], place)
                yield trial
    if choices.order:
        for a, b in combinations(range(len(pairs)), 2):
            trial = list(pairs)
            trial[a], trial[b] = pairs[b], pairs[a]
            yield trial
            yield [*pairs[:a], *reversed(pairs[a : b + 1]), *pairs[b + 1 :]]
            moved = list(pairs)
            moved.insert(b, moved.pop(a))
            yield moved
