"""Linear algebra of small matrices with the same bits on every processor.

BLAS and LAPACK, which numpy uses for ``@`` and ``np.linalg``, sum in an order that depends on the kind of processor and
the number of threads. A search for a minimum can then end elsewhere. Here sums have a fixed order, and each operation
rounds once (IEEE 754). All decisions in planning use these functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_SHORT = 8  # most terms of a sum that is computed by a loop
_NO_PIVOT = 1e-15  # relative to the largest pivot; a smaller one has no significant digits


def mul(a: npt.ArrayLike, b: npt.ArrayLike) -> Array:
    """Return ``a @ b`` of matrices, stacks of matrices (..., n, k) and (..., k, m), or vectors (k,)."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if b.ndim == 1:
        return np.einsum("...j,j->...", a, b)  # type: ignore[no-any-return]
    if a.ndim == 1:
        return np.asarray(np.einsum("j,...jk->...k", a, b))
    terms = a.shape[-1]
    if a.ndim + b.ndim == 4 or not 0 < terms <= _SHORT or terms != b.shape[-2]:
        return np.asarray(np.einsum("...ij,...jk->...ik", a, b))
    total = a[..., 0:1] * b[..., 0:1, :]
    for j in range(1, terms):
        total += a[..., j : j + 1] * b[..., j : j + 1, :]
    return np.asarray(total)


def norm(v: npt.ArrayLike) -> float:
    """Return the Euclidean norm of all numbers of `v`."""
    return math.sqrt(sum([x * x for x in np.asarray(v, dtype=float).ravel().tolist()]))


def solve_positive(H: Array, b: Array) -> Array:
    """Solve H x = b for symmetric positive definite H (..., n, n) and b (..., n) by Cholesky factorisation.

    If H is rank-deficient, undetermined directions of x (..., n) are 0.
    """
    H, b = np.asarray(H, dtype=float), np.asarray(b, dtype=float)
    n = H.shape[-1]
    if H.ndim == 2:  # plain Python numbers are ten times as fast for one matrix
        rows, right = H.tolist(), b.tolist()
        least = _NO_PIVOT * max(rows[j][j] for j in range(n))
        return np.array(_solved(rows, right, lambda pivot: math.sqrt(pivot) if pivot > least else math.inf))
    entries = [[H[..., i, j] for j in range(i + 1)] for i in range(n)]
    small = _NO_PIVOT * np.max([row[-1] for row in entries], axis=0)

    def root(pivot: Array) -> Array:
        return np.where(pivot > small, np.sqrt(np.maximum(pivot, 0.0)), np.inf)

    return np.stack(_solved(entries, [b[..., i] for i in range(n)], root), axis=-1)


def _solved(H: list[list[Any]], b: list[Any], root: Callable[[Any], Any]) -> list[Any]:
    """Solve for entries H[i][j] and b[i] that are numbers, or arrays for many matrices at once.

    `root` is the square root of a pivot, infinite if that has no significant digits.
    """
    n = len(b)
    L: list[list[Any]] = [[None] * n for _ in range(n)]
    y: list[Any] = []
    for j in range(n):
        pivot, right = H[j][j], b[j]
        for k in range(j):
            pivot, right = pivot - L[j][k] * L[j][k], right - L[j][k] * y[k]
        L[j][j] = root(pivot)
        y.append(right / L[j][j])
        for i in range(j + 1, n):
            entry = H[i][j]
            for k in range(j):
                entry = entry - L[i][k] * L[j][k]
            L[i][j] = entry / L[j][j]
    x = list(y)
    for j in reversed(range(n)):
        right = y[j]
        for i in range(j + 1, n):
            right = right - L[i][j] * x[i]
        x[j] = right / L[j][j]
    return x


def nearest_rotation(M: Array) -> Array:
    """Return the rotation nearest to a matrix M (3, 3) near one: the limit of X <- (X + X^-T) / 2 from M.

    Source: N. Higham, "Computing the polar decomposition", SIAM J. Sci. Stat. Comput. 7, 1986.
    """
    X = np.array(M, dtype=float)
    for _ in range(30):
        cofactors = np.cross(X[[1, 2, 0]], X[[2, 0, 1]])
        next_X = 0.5 * (X + cofactors / _dot(X[0], cofactors[0]))
        if np.array_equal(next_X, X) or np.abs(next_X - X).max() < 1e-16:
            return np.asarray(next_X)
        X = next_X
    return np.asarray(X)


def _dot(a: Array, b: Array) -> float:
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])
