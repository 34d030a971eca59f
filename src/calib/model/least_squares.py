"""Weighted least squares: Levenberg-Marquardt, elimination of unknowns (Schur complement), and scaled inverses.

All residuals r are measured minus predicted, and whitened: divided by their standard deviations. J is the derivative of
the prediction, so the normal equations are J^T J x = J^T r.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from arm.se3 import Array, Bools

State = TypeVar("State")
Step = Callable[[float], tuple[State, bool]]
"""Damping -> the next state, and whether it is so close to the present one that the search may stop."""

_MOST_DAMPING, _LEAST_DAMPING = 1e10, 1e-12


def levenberg_marquardt(
    start: State,
    cost: Callable[[State], float],
    linearise: Callable[[State], Step[State]],
    most_steps: int,
    damping: float = 1e-6,
) -> tuple[State, int]:
    """Minimise a sum of squares (D. W. Marquardt, 1963); return the best state and the number of steps to it.

    Args:
        start: initial state, of any type.
        cost: sum of squares at a state; NaN or infinite where there is none.
        linearise: returns the step from a state as a function of the damping, relative to the diagonal of J^T J.
        most_steps: after which to stop.
        damping: of the first step.
    """
    now, least, steps = start, cost(start), 0
    step = linearise(now)
    while steps < most_steps and damping <= _MOST_DAMPING:
        trial, close = step(damping)
        after = cost(trial)
        if not after <= least:  # also NaN
            damping *= 10.0
            continue
        now, least, damping, steps = trial, after, max(damping * 0.1, _LEAST_DAMPING), steps + 1
        if close:
            break
        step = linearise(now)
    return now, steps


@dataclass(frozen=True, eq=False)
class Eliminated:
    """Normal equations of the kept unknowns, and the eliminated ones as functions of them.

    Attributes:
        S: information of the kept unknowns, (..., k, k).
        g: negative gradient of half the cost, (..., k).
        by_kept: the eliminated unknowns are `alone` - `by_kept` @ kept, (..., e, k).
        alone: (..., e).
    """

    S: Array
    g: Array
    by_kept: Array
    alone: Array


def eliminate(
    J: Array,
    N: Array,
    r: Array,
    prior: Array | float = 0.0,
    gradient: Array | float = 0.0,
    damping: float = 0.0,
) -> Eliminated:
    """Eliminate unknowns from normal equations (Schur complement).

    Args:
        J: derivatives by the kept unknowns, (..., rows, k).
        N: derivatives by the eliminated ones, (..., rows, e).
        r: residuals, (..., rows).
        prior: information on the eliminated unknowns, (e, e).
        gradient: negative gradient of half the cost of that prior, (e,).
        damping: of the eliminated unknowns, relative to the diagonal of N^T N.
    """
    Nt, Jt = np.swapaxes(N, -1, -2), np.swapaxes(J, -1, -2)
    H = Nt @ N + prior
    if damping:
        H = H + damping * np.eye(H.shape[-1]) * H
    NJ, Nr = Nt @ J, (Nt @ r[..., None])[..., 0] + gradient
    both = np.linalg.solve(H, np.concatenate([NJ, Nr[..., None]], axis=-1))
    by_kept, alone = np.asarray(both[..., :-1], dtype=float), np.asarray(both[..., -1], dtype=float)
    JN = np.swapaxes(NJ, -1, -2)
    g = (Jt @ r[..., None] - JN @ alone[..., None])[..., 0]
    return Eliminated(np.asarray(Jt @ J - JN @ by_kept), np.asarray(g), by_kept, alone)


def solve_scaled(S: Array, g: Array) -> Array:
    """Return S^-1 g for a positive matrix whose rows differ by many orders of magnitude, as those of fx and k3 do.

    Raises:
        numpy.linalg.LinAlgError: some elements are not finite.
    """
    scale, scaled = _scaled(S)
    solution, *_ = np.linalg.lstsq(scaled, _finite((scale * g.T).T), rcond=1e-14)
    return np.asarray((scale * solution.T).T)


def inverse_scaled(S: Array) -> Array:
    """Return S^-1 for such a matrix; undetermined parameters get a very large variance.

    Raises:
        numpy.linalg.LinAlgError: some elements are not finite.
    """
    scale, scaled = _scaled(S)
    values, vectors = np.linalg.eigh(scaled)
    inverse = vectors @ np.diag(1.0 / np.maximum(values, 1e-15)) @ vectors.T
    return np.asarray(inverse * np.outer(scale, scale))


def embedded(some: Array, free: Bools) -> Array:
    """Embed the covariance of the free unknowns in that of all, (count, count), with zero rows for the others."""
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = some
    return covariance


def _scaled(S: Array) -> tuple[Array, Array]:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    return scale, _finite(S * np.outer(scale, scale))


def _finite(numbers: Array) -> Array:
    if not np.isfinite(numbers).all():  # LAPACK would print to the terminal
        raise np.linalg.LinAlgError("some elements are not finite")
    return numbers
