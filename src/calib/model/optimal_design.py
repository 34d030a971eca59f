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
        variances: variance after each of them and those before it, see `OptimalDesign.variance`.
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
        worth: (k, w); the summed variances of ``worth.T @ unknowns`` are minimised (A-optimal). None: the determinant
            of the covariance is (D-optimal).
        groups: of each measurement, (n,), from 0; equally many of each group are chosen. Default: one group.
    """

    def __init__(
        self, informations: Array, known: Array, worth: Array | None = None, groups: Array | None = None
    ) -> None:
        self._scale = 1.0 / np.sqrt(np.diag(known))
        both = np.outer(self._scale, self._scale)
        self._M, self._known = informations * both, known * both
        self._worth = None if worth is None else worth * self._scale[:, None]
        self._groups = np.zeros(len(informations)) if groups is None else groups
        values, vectors = np.linalg.eigh(self._M)
        values = np.maximum(values, 0.0)
        rank = int((values > _NOTHING * values.max(axis=1, keepdims=True)).sum(axis=1).max(initial=1))
        self._F = vectors[..., -rank:] * np.sqrt(values[:, None, -rank:])

    def variance(self, places: Iterable[int] = ()) -> float:
        """Variance after some measurements: sum (A), or geometric mean of the scaled principal variances (D)."""
        C = self._covariance(places)
        if self._worth is None:
            return float(np.exp(np.linalg.slogdet(C)[1] / len(C)))
        return float(np.sum(self._worth * (C @ self._worth)))

    def best(self, count: int, exchange: bool = True, begin: Iterable[int] = ()) -> Chosen:
        """Choose the best `count` measurements of each group, or all if there are fewer.

        The measurements of a single group are ordered, the most helpful first.

        Args:
            count: number of measurements.
            exchange: whether to revise choices; otherwise each is the best in addition to those before it.
            begin: indices of measurements to begin with, equally many of each group.
        """
        chosen, groups = list(begin), np.unique(self._groups)
        most = min(count * len(groups), len(self._M))
        while len(chosen) < most:
            chosen.append(self._next(chosen, chosen, groups[len(chosen) % len(groups)]))
        if exchange and most > 1:
            self._exchange(chosen)
            chosen = self._ordered(chosen) if len(groups) == 1 else chosen
        left = tuple(self.variance(chosen[: i + 1]) for i in range(most))
        return Chosen(tuple(chosen), left, self.variance())

    def _exchange(self, chosen: list[int]) -> None:
        now = self.variance(chosen)
        for _ in range(_PASSES):
            before = now
            for place in range(len(chosen)):
                others = chosen[:place] + chosen[place + 1 :]
                chosen[place] = self._next(others, others, self._groups[chosen[place]])
            now = self.variance(chosen)
            if before - now < _GAIN_DONE * before:
                break

    def _ordered(self, chosen: list[int]) -> list[int]:
        order: list[int] = []
        every = set(range(len(self._M)))
        while len(order) < len(chosen):
            order.append(self._next(order, every - set(chosen) | set(order)))
        return order

    def _next(self, taken: Iterable[int], closed: Iterable[int], group: float | None = None) -> int:
        """Index of the most helpful measurement of a group in addition to those taken, except the closed ones."""
        C = self._covariance(taken)
        CF = C @ self._F
        G = np.eye(CF.shape[-1]) + np.swapaxes(self._F, 1, 2) @ CF
        if self._worth is None:
            gain = np.linalg.slogdet(G)[1]
        else:
            weighted = self._worth.T @ CF
            gain = np.einsum("nwr,nrw->n", weighted, np.linalg.solve(G, np.swapaxes(weighted, 1, 2)))
        gain[list(closed)] = -np.inf
        if group is not None:
            gain[self._groups != group] = -np.inf
        return int(np.argmax(gain))

    def _covariance(self, places: Iterable[int]) -> Array:
        chosen = list(places)
        return np.asarray(np.linalg.inv(self._known + self._M[chosen].sum(axis=0)))
