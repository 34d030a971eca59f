"""Score (Lagrange multiplier) test: how much would further unknowns, which are not in a fit, explain?

One linear step at the solution, with all fitted unknowns free, gives their size and significance (C. R. Rao, 1948). No
refit is needed. The estimate has a standard deviation, so a target is reported as bent by 0.5 mm, not just as
suspicious.
"""

from __future__ import annotations

from dataclasses import dataclass

from arm.se3 import Array
from calib.model.least_squares import inverse_scaled, solve_scaled


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """Evidence for further unknowns.

    Attributes:
        amount: their estimates, (m,).
        covariance: of the estimates if the residuals were whitened, (m, m).
        drop: decrease of the cost if the model included them.
        others: change of the fitted unknowns per unit of each, (fitted, m).
    """

    amount: Array
    covariance: Array
    drop: float
    others: Array


def score_test(
    fitted: Array, gradient: Array, coupling: Array, tested: Array, tested_gradient: Array
) -> ScoreTest:
    """Test unknowns at the solution of a fit.

    Args:
        fitted: covariance of the fitted unknowns, (n, n).
        gradient: negative gradient of half the cost by them, (n,): zero at the exact solution.
        coupling: mixed block of the normal equations, (n, m).
        tested: information on the tested unknowns, (m, m).
        tested_gradient: negative gradient of half the cost by them, (m,).
    """
    back = fitted @ coupling
    rest = tested_gradient - back.T @ gradient
    information = tested - coupling.T @ back
    amount = solve_scaled(information, rest)
    return ScoreTest(amount, inverse_scaled(information), float(rest @ amount), -back)
