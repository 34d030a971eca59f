"""Optimal design: choose the measurements that together leave the smallest variance.

The information of measurements is known before they are taken, and it adds up. The search is greedy, then by exchange
(V. V. Fedorov, "Theory of optimal experiments", 1972). The information of one measurement has low rank, so its effect
follows from the inverse without it (M. Woodbury, 1950).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array

_PASSES = 8
_GAIN_DONE = 1e-3  # relative gain at which to stop exchanging
_NOTHING = 1e-9  # relative to the largest eigenvalue of a matrix


@dataclass(frozen=True)
class Chosen:
    """Chosen measurements.

    Attributes:
        places: their indices, in the order of choice.
        variances: summed variances after each of them and those before it.
        before: variance with the prior information alone.
    """

    places: tuple[int, ...]
    variances: tuple[float, ...]
    before: float


class OptimalDesign:
    """Candidate measurements and prior information.

    Args:
        informations: of each measurement, (n, k, k).
        known: prior information, (k, k), positive definite.
        worth: (k, w); the summed variances of ``worth.T @ unknowns`` are minimised (A-optimal).
    """

    def __init__(self, informations: Array, known: Array, worth: Array) -> None:
        self._scale = 1.0 / np.sqrt(np.diag(known))
        both = np.outer(self._scale, self._scale)
        self._M, self._known = informations * both, known * both
        self._worth = worth * self._scale[:, None]
        values, vectors = np.linalg.eigh(self._M)
        values = np.maximum(values, 0.0)
        rank = int((values > _NOTHING * values.max(axis=1, keepdims=True)).sum(axis=1).max(initial=1))
        self._F = vectors[..., -rank:] * np.sqrt(values[:, None, -rank:])

    def variance(self, places: Iterable[int] = ()) -> float:
        """Summed variances after some measurements."""
        return float(np.sum(self._worth * (self._covariance(places) @ self._worth)))

    def best(self, count: int, exchange: bool = True, begin: Iterable[int] = ()) -> Chosen:
        """Choose the best `count` measurements, the most helpful first, or all if there are fewer.

        Args:
            count: number of measurements.
            exchange: whether to revise choices; otherwise each is the best in addition to those before it.
            begin: indices of measurements to begin with.
        """
        chosen = list(begin)
        most = min(count, len(self._M))
        while len(chosen) < most:
            chosen.append(self._next(chosen, chosen))
        if exchange and most > 1:
            self._exchange(chosen)
            chosen = self._ordered(chosen)
        left = tuple(self.variance(chosen[: i + 1]) for i in range(most))
        return Chosen(tuple(chosen), left, self.variance())

    def _exchange(self, chosen: list[int]) -> None:
        now = self.variance(chosen)
        for _ in range(_PASSES):
            before = now
            for place in range(len(chosen)):
                others = chosen[:place] + chosen[place + 1 :]
                chosen[place] = self._next(others, others)
            now = self.variance(chosen)
            if before - now < _GAIN_DONE * before:
                break

    def _ordered(self, chosen: list[int]) -> list[int]:
        order: list[int] = []
        every = set(range(len(self._M)))
        while len(order) < len(chosen):
            order.append(self._next(order, every - set(chosen) | set(order)))
        return order

    def _next(self, taken: Iterable[int], closed: Iterable[int]) -> int:
        """Index of the most helpful measurement in addition to those taken, except the closed ones."""
        CF = self._covariance(taken) @ self._F
        gain = self._gain(CF, np.eye(CF.shape[-1]) + np.swapaxes(self._F, 1, 2) @ CF)
        gain[list(closed)] = -np.inf
        return int(np.argmax(gain))

    def _gain(self, CF: Array, G: Array) -> Array:
        """What each measurement takes off the variance, (n,), from C F and 1 + F^T C F."""
        weighted = self._worth.T @ CF
        solved = np.linalg.solve(G, np.swapaxes(weighted, 1, 2))
        return np.asarray(np.einsum("nwr,nrw->n", weighted, solved))

    def _covariance(self, places: Iterable[int]) -> Array:
        chosen = list(places)
        return np.asarray(np.linalg.inv(self._known + self._M[chosen].sum(axis=0)))
