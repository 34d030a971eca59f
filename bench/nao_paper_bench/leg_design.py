"""Optimal design of measurements of two legs: equally many of each, for the variances or for the determinant."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from arm.se3 import Array, Indices
from calib.model.optimal_design import OptimalDesign


class LegDesign(OptimalDesign):
    """Candidate measurements of two legs, of which equally many of each are chosen.

    Args:
        informations, known: see `OptimalDesign`.
        worth: the same (A-optimal); None: the determinant of the covariance is minimised (D-optimal).
        legs: of each measurement, 0 or 1, (n,).
    """

    def __init__(self, informations: Array, known: Array, worth: Array | None, legs: Indices) -> None:
        super().__init__(informations, known, np.zeros((len(known), 0)) if worth is None else worth)
        self._legs, self._by_determinant = legs, worth is None

    def variance(self, places: Iterable[int] = ()) -> float:
        """Summed variances (A), or geometric mean of the scaled principal variances (D), after some measurements."""
        if not self._by_determinant:
            return super().variance(places)
        C = self._covariance(places)
        return float(np.exp(np.linalg.slogdet(C)[1] / len(C)))

    def _gain(self, CF: Array, G: Array) -> Array:
        return np.asarray(np.linalg.slogdet(G)[1]) if self._by_determinant else super()._gain(CF, G)

    def _next(self, taken: Iterable[int], closed: Iterable[int]) -> int:
        """The most helpful measurement of the leg of which fewer are taken."""
        counts = np.bincount(self._legs[list(taken)], minlength=2)
        of_other_leg = np.flatnonzero(self._legs != np.argmin(counts))
        return super()._next(taken, {*closed, *of_other_leg.tolist()})

    def _ordered(self, chosen: list[int]) -> list[int]:
        return chosen
