"""Least squares: the minimum against scipy's, elimination against the whole system, and scaled inverses."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib.model.least_squares import (
    eliminate,
    embedded,
    inverse_scaled,
    levenberg_marquardt,
    solve_scaled,
)

TIMES = np.linspace(0.0, 4.0, 25)


def decay(x):
    """Amplitude, rate, frequency and offset."""
    return x[0] * np.exp(-x[1] * TIMES) * np.cos(x[2] * TIMES) + x[3]


def residuals_of(seed):
    rng = np.random.default_rng(seed)
    true = np.array([2.0, 0.4, 3.0, 0.5]) * rng.uniform(0.8, 1.2, 4)
    measured = decay(true) + 0.05 * rng.standard_normal(len(TIMES))
    return (lambda x: measured - decay(x)), true


def minimised(residuals, start, most_steps=100):
    """The solution, the number of steps, and every damping that was tried."""
    tried = []

    def linearise(x):
        J = np.stack([(residuals(x - h) - residuals(x + h)) / 2e-6 for h in 1e-6 * np.eye(len(x))], axis=-1)
        H, g = J.T @ J, J.T @ residuals(x)

        def step(damping):
            tried.append(damping)
            change = np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
            return x + change, bool(np.abs(change).max() < 1e-9)

        return step

    found, steps = levenberg_marquardt(
        start, lambda x: float(np.sum(residuals(x) ** 2)), linearise, most_steps
    )
    return found, steps, tried


@pytest.mark.parametrize("seed", range(8))
def test_the_minimum_is_scipys(seed):
    residuals, true = residuals_of(seed)
    start = true * np.random.default_rng([seed, 1]).uniform(0.75, 1.25, 4)
    found, steps, _ = minimised(residuals, start)
    theirs = least_squares(residuals, start, method="lm", xtol=1e-14, ftol=1e-14)
    assert found == pytest.approx(theirs.x, abs=1e-7)
    assert 2 < steps < 40


def test_a_step_that_costs_more_is_not_taken():
    """From far away the undamped step overshoots: the damping grows, and the cost falls with every step."""
    residuals, true = residuals_of(3)
    start = true + [3.0, 1.5, 0.9, -2.0]
    _, steps, tried = minimised(residuals, start)
    assert max(tried) > 1e-5
    assert len(tried) > steps
    costs = [np.sum(residuals(minimised(residuals, start, n)[0]) ** 2) for n in range(steps)]
    assert all(later <= earlier for earlier, later in pairwise(costs))


def test_a_cost_that_is_nan_is_refused_and_a_hopeless_start_is_left():
    found, steps = levenberg_marquardt(
        1.0, lambda x: x if x >= 1.0 else float("nan"), lambda x: lambda d: (x - 1.0, False), 9
    )
    assert (found, steps) == (1.0, 0)


def system(seed, rows=40, kept=4, gone=5):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((rows, kept)), rng.standard_normal((rows, gone)), rng.standard_normal(rows)


def test_elimination_solves_the_whole_system():
    J, N, r = system(1)
    prior, mean = np.diag(np.arange(1.0, 6.0)), np.arange(5.0)
    own = eliminate(J, N, r, prior, prior @ mean)
    kept = np.linalg.solve(own.S, own.g)
    whole = np.concatenate([J, N], axis=1)
    H, g = whole.T @ whole, whole.T @ r
    H[4:, 4:] += prior
    g[4:] += prior @ mean
    assert np.append(kept, own.alone - own.by_kept @ kept) == pytest.approx(np.linalg.solve(H, g), abs=1e-12)
    assert np.linalg.inv(own.S) == pytest.approx(np.linalg.inv(H)[:4, :4], abs=1e-12)


def test_damping_is_of_the_eliminated_unknowns_alone():
    J, N, r = system(2)
    damped = eliminate(J, N, r, damping=0.5)
    H = N.T @ N
    H += 0.5 * np.diag(np.diag(H))
    assert pytest.approx(J.T @ J - J.T @ N @ np.linalg.solve(H, N.T @ J), abs=1e-12) == damped.S


def test_stacks_are_eliminated_one_by_one_and_nothing_may_be_eliminated():
    stacked = [np.stack(parts) for parts in zip(*(system(seed) for seed in range(3)), strict=True)]
    own = eliminate(*stacked)
    for seed in range(3):
        alone = eliminate(*system(seed))
        assert own.S[seed] == pytest.approx(alone.S, abs=1e-12)
        assert own.g[seed] == pytest.approx(alone.g, abs=1e-12)
    J, N, r = system(4, gone=0)
    assert pytest.approx(J.T @ J, abs=1e-12) == eliminate(J, N, r).S


def test_scales_that_differ_by_orders_of_magnitude_are_solved():
    rng = np.random.default_rng(5)
    scale = 10.0 ** np.array([-8.0, -3.0, 0.0, 4.0, 9.0])
    A = rng.standard_normal((9, 5))
    S = (A.T @ A) * np.outer(scale, scale)
    x = rng.standard_normal(5) / scale
    assert solve_scaled(S, S @ x) * scale == pytest.approx(x * scale, rel=1e-9)
    assert inverse_scaled(S) @ S * np.outer(1.0 / scale, scale).T == pytest.approx(np.eye(5), abs=1e-9)
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        inverse_scaled(S * np.nan)


def test_held_unknowns_have_no_variance():
    free = np.array([True, False, True])
    assert embedded(np.array([[1.0, 2.0], [2.0, 5.0]]), free).tolist() == [[1, 0, 2], [0, 0, 0], [2, 0, 5]]
