"""Measurements of two legs: each leg gets its share, for the variances and for the determinant."""

from itertools import combinations, product

import numpy as np
import pytest
from nao_paper_bench.leg_design import LegDesign

from calib.model.optimal_design import OptimalDesign

LEGS = np.repeat([0, 1], 6)


def some(seed):
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((12, 5, 2)) * 10.0 ** rng.uniform(-1, 1, (12, 1, 1))
    worth = rng.standard_normal((5, 3))
    known = np.diag(10.0 ** rng.uniform(-2, 0, 5))
    return F @ np.swapaxes(F, 1, 2), known, worth


def pairs_of_pairs():
    return [(*a, *b) for a, b in product(combinations(range(6), 2), combinations(range(6, 12), 2))]


def left(informations, known, worth, chosen):
    return np.trace(worth.T @ np.linalg.inv(known + informations[list(chosen)].sum(axis=0)) @ worth)


def test_a_choice_for_the_determinant_is_nearly_the_best_of_all():
    for seed in range(4):
        informations, known, _ = some(seed)
        best = LegDesign(informations, known, None, LEGS).best(4)
        every = {c: np.linalg.slogdet(known + informations[list(c)].sum(axis=0))[1] for c in pairs_of_pairs()}
        assert every[tuple(sorted(best.places))] > max(every.values()) - 0.05
        scaled = np.linalg.slogdet(known)[1] - every[tuple(sorted(best.places))]
        assert best.variances[-1] == pytest.approx(np.exp(scaled / 5), rel=1e-8)


def test_each_leg_gets_its_share_whatever_the_other_would_add():
    informations, known, worth = some(7)
    informations[LEGS == 1] *= 1e-3
    alone = OptimalDesign(informations, known, worth).best(4)
    assert (LEGS[list(alone.places)] == 0).all()
    shared = LegDesign(informations, known, worth, LEGS)
    best = shared.best(4)
    assert sorted(LEGS[list(best.places)].tolist()) == [0, 0, 1, 1]
    every = [left(informations, known, worth, c) for c in pairs_of_pairs()]
    assert best.variances[-1] <= 1.02 * min(every)
    assert shared.best(4, exchange=False, begin=[5, 11]).places[:2] == (5, 11)
    again = shared.best(4, begin=[0, 1, 6, 7])
    assert again.variances[-1] <= left(informations, known, worth, [0, 1, 6, 7])
