"""The bound of orders and assignments: never above any sequence, and near the best where places do not matter much."""

from __future__ import annotations

from itertools import pairwise, permutations

import numpy as np
import pytest

from plan.program.assignment import order_bound as bounds
from plan.program.assignment.order_bound import LegTimes, order_bound


def drawn(seed: int, picks: int, places: int) -> LegTimes:
    """Ways between points in two clusters, and what every number of moved cubes adds to a way back."""
    rng = np.random.default_rng([seed, picks, places])
    home, start, goal = np.zeros(2), rng.uniform(1.0, 2.0, (picks, 2)), -rng.uniform(1.0, 2.0, (places, 2))
    apart = np.linalg.norm(start[:, None] - goal[None], axis=-1)
    more = rng.uniform(0.0, 0.5, picks)
    begin, end = (np.linalg.norm(points - home, axis=1) for points in (start, goal))
    return LegTimes(begin, apart, apart.T[None] + more[:, None, None], end)


def best(legs: LegTimes) -> float:
    picks, places = legs.carry.shape
    times = []
    for order in permutations(range(picks)):
        for to in permutations(range(places), picks):
            pairs = list(zip(order, to, strict=True))
            time = legs.begin[order[0]] + legs.end[to[-1]] + sum(legs.carry[pair] for pair in pairs)
            time += sum(legs.go_on[k, a[1], b[0]] for k, (a, b) in enumerate(pairwise(pairs), start=1))
            times.append(float(time))
    return min(times)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("picks", "places"), [(2, 2), (3, 3), (4, 4), (3, 5), (2, 6), (5, 5)])
def test_no_sequence_undercuts_the_bound(picks: int, places: int, seed: int) -> None:
    legs = drawn(seed, picks, places)
    least = best(legs)
    for upper in (least, 1.3 * least):
        found = order_bound(legs, upper)
        assert 0.97 * least < found <= least + 1e-9


def test_prices_raise_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without them the nearest place is used again and again, and two assignments leave subtours."""
    gained = []
    for seed in range(8):
        legs = drawn(seed, 7, 7)
        legs.carry[:, 0] *= 0.5
        legs.go_on[:, 0] *= 0.5
        with_prices = order_bound(legs, 100.0)
        with monkeypatch.context() as patch:
            patch.setattr(bounds, "_STEPS", 1)
            gained.append(with_prices / order_bound(legs, 100.0) - 1.0)
    assert min(gained) >= 0.0
    assert np.median(gained) > 0.005


@pytest.mark.parametrize("seed", range(3))
def test_places_that_stay_empty_change_nothing(seed: int) -> None:
    """Twenty more places, so far away that no cube goes there."""
    legs, more = drawn(seed, 5, 6), 20
    far = LegTimes(
        legs.begin,
        np.pad(legs.carry, ((0, 0), (0, more)), constant_values=legs.carry.max()),
        np.pad(legs.go_on, ((0, 0), (0, more), (0, 0)), constant_values=1e3),
        np.pad(legs.end, (0, more), constant_values=1e3),
    )
    assert order_bound(far, 100.0) == order_bound(legs, 100.0)


def test_many_picks_are_bounded_by_assignments(monkeypatch: pytest.MonkeyPatch) -> None:
    legs = drawn(0, 5, 5)
    sharp = order_bound(legs, 100.0)
    monkeypatch.setattr(bounds, "_MOST_PICKS", 4)
    assert 0.8 * sharp < order_bound(legs, 100.0) <= sharp
