"""Costs through layers: exact to go, and never below the bound."""

from __future__ import annotations

import itertools
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from arm.controller.unit import Limits
from plan.program.goals.leg_times import leg_times, passing
from plan.program.goals.line_chains import LineChain
from plan.program.sequence.layers import Layer, cost_to_go, lower_bound
from plan.program.sequence.times import ChainTime, standing_time

LIMITS = Limits(np.full(3, -3.0), np.full(3, 3.0), np.array([1.0, 0.5, 2.0]), np.array([2.0, 2.0, 4.0]))


def layers(seed: int, count: int, width: int) -> list[Layer]:
    """Chains that are stopped at once, each with time of its own between its ends."""
    rng = np.random.default_rng(seed)
    made = [Layer("start", (), (standing_time(rng.uniform(-2.0, 2.0, 3)),))]
    for number in range(count):
        times = []
        for _ in range(width):
            ends = [passing(q, q, np.zeros(3), 0.0, True) for q in rng.uniform(-2.0, 2.0, (2, 3))]
            inner = float(rng.uniform(0.0, 1.0))
            times.append(ChainTime(*ends, inner, 0.9 * inner))
        made.append(Layer(str(number), (), tuple(times)))
    still = np.zeros(3)
    chains = [tuple(LineChain((), "", still, still) for _ in layer.times) for layer in made]
    return [Layer(layer.name, chain, layer.times) for layer, chain in zip(made, chains, strict=True)]


@pytest.mark.parametrize("seed", range(3))
def test_what_is_to_go_is_the_best_of_all_sequences_and_bounded(seed: int) -> None:
    made = layers(seed, 3, 4)
    estimates = [leg_times(a.depart, b.arrive, LIMITS) for a, b in pairwise(made)]
    times = []
    for indices in itertools.product(*(range(len(layer.times)) for layer in made)):
        legs = [e[i, j] for e, (i, j) in zip(estimates, pairwise(indices), strict=True)]
        inner = [layer.times[i].inner for layer, i in zip(made[1:], indices[1:], strict=True)]
        times.append(sum(legs) + sum(inner))
    left = cost_to_go(made, estimates)
    assert left[0] == pytest.approx(np.array([min(times)]))
    assert (left[-1] == 0.0).all()
    bound = lower_bound(made, LIMITS)
    assert 0.8 * min(times) < bound <= min(times)
    # what leads away from the last stops counts too
    tails = [replace(t, depart=replace(t.depart, least=np.array([1.5]))) for t in made[-1].times]
    assert lower_bound([*made[:-1], replace(made[-1], times=tuple(tails))], LIMITS) == pytest.approx(
        bound + 1.5
    )
