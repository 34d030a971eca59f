"""Optimal design: measurements chosen by the variance that they leave."""

from itertools import combinations

import numpy as np
import pytest

from calib.model.optimal_design import OptimalDesign


def some(seed, count=9, k=5, rank=2):
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((count, k, rank)) * 10.0 ** rng.uniform(-1, 1, (count, 1, 1))
    worth = rng.standard_normal((k, 3))
    known = np.diag(10.0 ** rng.uniform(-2, 0, k))
    return F @ np.swapaxes(F, 1, 2), known, worth


def left(informations, known, worth, chosen):
    return np.trace(worth.T @ np.linalg.inv(known + informations[list(chosen)].sum(axis=0)) @ worth)


@pytest.mark.parametrize("seed", range(6))
def test_the_choice_is_nearly_the_best_of_all_and_says_what_it_leaves(seed):
    informations, known, worth = some(seed)
    best = OptimalDesign(informations, known, worth).best(3)
    every = [left(informations, known, worth, c) for c in combinations(range(9), 3)]
    assert len(set(best.places)) == 3
    assert best.variances[-1] == pytest.approx(left(informations, known, worth, best.places), rel=1e-8)
    assert best.before == pytest.approx(left(informations, known, worth, []), rel=1e-8)
    assert best.variances[-1] <= 1.02 * min(every)
    assert list(best.variances) == sorted(best.variances, reverse=True)


def test_the_first_is_the_best_alone_and_exchange_never_harms():
    for seed in range(20):
        informations, known, worth = some(seed, 30)
        choice = OptimalDesign(informations, known, worth)
        alone = [left(informations, known, worth, [i]) for i in range(30)]
        assert choice.best(1).places == (int(np.argmin(alone)),)
        greedy, exchanged = choice.best(5, exchange=False), choice.best(5)
        assert exchanged.variances[-1] <= greedy.variances[-1] * (1 + 1e-9)


def test_no_more_are_chosen_than_there_are():
    informations, known, worth = some(1, 4)
    assert sorted(OptimalDesign(informations, known, worth).best(7).places) == [0, 1, 2, 3]


def test_greedy_choices_are_better_than_any_drawn_by_lot():
    rng = np.random.default_rng(3)
    halves = [rng.standard_normal((3, 9)) * rng.uniform(0.1, 3.0) for _ in range(24)]
    informations, known = np.array([h.T @ h for h in halves]), 1e-3 * np.eye(9)
    best = OptimalDesign(informations, known, np.eye(9)).best(8, exchange=False)
    assert len(set(best.places)) == 8
    assert best.variances[-1] == pytest.approx(left(informations, known, np.eye(9), best.places), rel=1e-8)
    lots = [rng.choice(24, 8, replace=False) for _ in range(200)]
    assert best.variances[-1] < min(left(informations, known, np.eye(9), lot) for lot in lots)
