"""A lower bound over all orders and assignments, for tasks with too many of them to try.

Dynamic programming over the picks done and the last place covers all orders of the picks (M. Held, R. Karp, 1962). The
state leaves out which other places are filled, so a place may be used twice. Subgradient steps (B. Polyak, 1969) find a
price for each place that makes this cost more (N. Christofides, A. Mingozzi, P. Toth, "State-space relaxation
procedures for the computation of bounds to routing problems", 1981).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from math import fsum

import numpy as np
from scipy.optimize import linear_sum_assignment

from arm.se3 import Array, Indices

_MOST_PICKS = 13
_STEPS, _IDLE = 60, 6  # number of subgradient steps; steps without gain after which the step length is halved
_CLOSE = 1e-4  # s, gap between the bound and a sequence at which the steps end


@dataclass(frozen=True, eq=False)
class LegTimes:
    """Least times of legs, s.

    Attributes:
        begin: (picks,) from the start.
        carry: (picks, places).
        go_on: (picks, places, picks): by the number of cubes moved before, from place to pick.
        end: (places,) to the end.
    """

    begin: Array
    carry: Array
    go_on: Array
    end: Array


def order_bound(legs: LegTimes, upper: float) -> float:
    """Return a lower bound on the times of all sequences, s.

    Args:
        legs: least times.
        upper: time of some sequence, s; the bound is no higher.
    """
    picks, places = legs.carry.shape
    price, best, length, idle = np.zeros(places), _by_assignments(legs), 1.0, 0
    for _ in range(_STEPS if picks <= _MOST_PICKS else 0):
        time, used = _cheapest(legs, price)
        bound = fsum([time, *(-price).tolist()])
        idle = 0 if bound > best + _CLOSE else idle + 1
        best = max(best, bound)
        oftener = np.bincount(used, minlength=places) - 1.0
        if picks < places:  # a place with price 0 may stay empty
            oftener = np.where((price > 0.0) | (oftener > 0.0), oftener, 0.0)
        if best >= upper - _CLOSE or not oftener.any():
            break
        if idle >= _IDLE:
            length, idle = 0.5 * length, 0
        price = price + length * max(upper - bound, _CLOSE) / float((oftener * oftener).sum()) * oftener
        if picks < places:
            price = np.maximum(price, 0.0)
    return min(best, upper)


def _by_assignments(legs: LegTimes) -> float:
    """Return the sum of the shortest carries and of the shortest other legs, as two assignment problems, s."""
    n, m = legs.carry.shape
    ways = np.full((m + 1, n + 1), legs.carry.max())
    ways[0, :n], ways[1:, n] = legs.begin, legs.end
    ways[1:, :n] = legs.go_on[1:].min(axis=0)
    parts = [table[linear_sum_assignment(table)] for table in (legs.carry, ways)]
    return fsum(np.concatenate(parts).tolist())


def _cheapest(legs: LegTimes, price: Array) -> tuple[float, list[int]]:
    """Return time and places of the fastest sequence in which a place may be used again, at a price (places,) s."""
    carry = legs.carry + price
    time = legs.begin[:, None] + carry  # (sets of picks, last places) s
    layers = _layers(len(legs.begin))
    steps: list[tuple[Indices, Indices]] = []
    for count, layer in enumerate(layers, start=1):
        onward = time[:, :, None] + legs.go_on[count]
        left = onward.argmin(axis=1)  # (sets, next pick): the best place before it
        over = np.take_along_axis(onward, left[:, None], axis=1)[:, 0]
        arrived = over[layer.before, layer.members][:, :, None] + carry[layer.members]
        member = arrived.argmin(axis=1)  # (sets, last place): the pick that was last
        time = np.take_along_axis(arrived, member[:, None], axis=1)[:, 0]
        steps.append((left, member))
    ends = time[0] + legs.end
    place = int(ends.argmin())
    used, at = [place], 0
    for (left, member), layer in zip(reversed(steps), reversed(layers), strict=True):
        which = member[at, place]
        pick, at = layer.members[at, which], layer.before[at, which]
        place = int(left[at, pick])
        used.append(place)
    return float(ends.min()), used


@dataclass(frozen=True, eq=False)
class _Layer:
    """Sets of picks of one size.

    Attributes:
        members: (sets, size) picks.
        before: (sets, size) numbers of the sets without each member, in the layer before.
    """

    members: Indices
    before: Indices


@lru_cache(maxsize=16)
def _layers(picks: int) -> tuple[_Layer, ...]:
    """Return the sets of 2, 3, .. picks."""
    layers = []
    number: dict[tuple[int, ...], int] = {(i,): i for i in range(picks)}
    for size in range(2, picks + 1):
        sets = list(combinations(range(picks), size))
        before = [[number[(*s[:t], *s[t + 1 :])] for t in range(size)] for s in sets]
        layers.append(_Layer(np.array(sets), np.array(before)))
        number = {s: i for i, s in enumerate(sets)}
    return tuple(layers)
