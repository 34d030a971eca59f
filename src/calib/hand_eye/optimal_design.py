"""Which of many measurements to take: those that together leave the least error, each one's information being known
before it is taken.

Information adds up over measurements. The best sum is looked for greedily first, then by exchange (V. V. Fedorov,
"Theory of optimal experiments", 1972); what matters is a sum of variances (A-optimal). A measurement's information has
a low rank, so what it would leave is had from the inverse without it (M. Woodbury, 1950).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array

_PASSES = 8
_GAIN_DONE = 1e-3  # of the variance, by one more pass of exchanges
_NOTHING = 1e-9  # part of a matrix' largest eigenvalue


@dataclass(frozen=True)
class Chosen:
    """Measurements that were chosen.

    Attributes:
        places: of them among all, in the order of choice.
        variances: what is left after each of them, the ones before it taken.
        before: what there was before.
    """

    places: tuple[int, ...]
    variances: tuple[float, ...]
    before: float


class InformationChoice:
    """Measurements with what is known without them.

    Args:
        informations: of each measurement, (n, k, k).
        known: information of what is known already, (k, k), positive.
        worth: (k, w); the error that matters is that of ``worth.T @ unknowns``, its variances summed.
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
        """What some measurements leave."""
        C = self._covariance(places)
        return float(np.sum(self._worth * (C @ self._worth)))

    def best(self, count: int, exchange: bool = True) -> Chosen:
        """The `count` that together leave least, in an order in which each one helps most; fewer if there are not so
        many.

        Args:
            count: how many.
            exchange: whether choices are looked at again; without it each is the best only after those before it.
        """
        count = min(count, len(self._M))
        chosen: list[int] = []
        for _ in range(count):
            chosen.append(self._next(chosen, chosen))
        if exchange and count > 1:
            self._exchange(chosen)
            chosen = self._ordered(chosen)
        left = tuple(self.variance(chosen[: i + 1]) for i in range(count))
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
        """The one that helps most beside those taken, of all but those that are closed."""
        C = self._covariance(taken)
        CF = C @ self._F
        G = np.eye(CF.shape[-1]) + np.swapaxes(self._F, 1, 2) @ CF
        seen = self._worth.T @ CF
        gain = np.einsum("nwr,nrw->n", seen, np.linalg.solve(G, np.swapaxes(seen, 1, 2)))
        gain[list(closed)] = -np.inf
        return int(np.argmax(gain))

    def _covariance(self, places: Iterable[int]) -> Array:
        chosen = list(places)
        return np.asarray(np.linalg.inv(self._known + self._M[chosen].sum(axis=0)))
