"""The score test of a linear model is its refit: estimates, significance, and what the other unknowns would do."""

import numpy as np
import pytest

from calib.model.score_test import score_test


@pytest.mark.parametrize(("seed", "m"), [(1, 1), (2, 3)])
def test_a_linear_model_needs_no_refit(seed, m):
    rng = np.random.default_rng(seed)
    A, E = rng.standard_normal((60, 5)), rng.standard_normal((60, m)) + 0.3
    y = A @ rng.standard_normal(5) + E @ np.full(m, 0.7) + 0.1 * rng.standard_normal(60)
    x = np.linalg.lstsq(A, y, rcond=None)[0] + 0.02 * rng.standard_normal(5)  # not quite the solution
    r = y - A @ x
    fitted, g = np.linalg.inv(A.T @ A), A.T @ r
    test = score_test(fitted, g, A.T @ E, E.T @ E, E.T @ r)
    whole = np.concatenate([A, E], axis=1)
    refit = np.linalg.lstsq(whole, y, rcond=None)[0]
    left = y - whole @ refit
    assert test.amount == pytest.approx(refit[5:], abs=1e-10)
    assert test.covariance == pytest.approx(np.linalg.inv(whole.T @ whole)[5:, 5:], abs=1e-10)
    assert test.drop + g @ fitted @ g == pytest.approx(r @ r - left @ left, abs=1e-9)
    assert x + fitted @ g + test.others @ test.amount == pytest.approx(refit[:5], abs=1e-10)


def test_errors_that_are_not_there_drop_the_cost_as_chi_square_does():
    rng = np.random.default_rng(3)
    A, E = rng.standard_normal((40, 3)), rng.standard_normal((40, 2))
    fitted = np.linalg.inv(A.T @ A)
    drops = []
    for _ in range(2000):
        r = rng.standard_normal(40)
        r = r - A @ (fitted @ (A.T @ r))
        drops.append(score_test(fitted, A.T @ r, A.T @ E, E.T @ E, E.T @ r).drop)
    assert np.mean(drops) == pytest.approx(2.0, abs=0.15)
    assert np.quantile(drops, 0.95) == pytest.approx(5.99, abs=0.5)
