"""Straight joint lines that are checked at samples, by coal's collision test."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from math import ceil

import numpy as np

from arm.se3 import Array, frozen

# Fractions of a line that are checked first: most lines are blocked, and a few samples show it.
FIRST_SAMPLES = 0.5, 0.25, 0.75, 0.125, 0.375, 0.625, 0.875


class SampledEdges:
    """Checks of configurations and of straight joint lines between them, at samples, which prove nothing.

    Args:
        too_near: returns whether a configuration lacks the clearance (`World.too_near`).
        resolution: largest distance of two samples, rad summed over the joints.
    """

    def __init__(self, too_near: Callable[[Array], bool], resolution: float) -> None:
        self.too_near, self.resolution = too_near, resolution

    def clear(self, a: Array, b: Array) -> bool:
        """Return whether all samples between a and b are free."""
        return self.blocked(a, b) is None

    def blocked(self, a: Array, b: Array) -> float | None:
        """Return the fraction of the first sample found between a and b that is not free; None if all are.

        Samples are checked from coarse to fine: blocked lines end soon.
        """
        places = coarse_to_fine(self._count(a, b))
        for u, q in zip(places.tolist(), a + places[:, None] * (b - a), strict=True):
            if self.too_near(q):
                return float(u)
        return None

    def path_clear(self, path: Array) -> bool:
        """Return whether all inner way-points of a path (m, n), and the lines between them, are free."""
        return not any(map(self.too_near, path[1:-1])) and all(self.clear(a, b) for a, b in pairwise(path))

    def advance(self, a: Array, b: Array) -> tuple[list[Array], bool]:
        """Return the free samples from a (excluded) to b before the first blocked one, and whether b is reached."""
        count, passed = self._count(a, b), list[Array]()
        for q in (*(a + (np.arange(1, count) / count)[:, None] * (b - a)), b):
            if self.too_near(q):
                return passed, False
            passed.append(q)
        return passed, True

    def _count(self, a: Array, b: Array) -> int:
        return max(ceil(float(np.abs(b - a).sum()) / self.resolution), 1)


@lru_cache(maxsize=4096)
def coarse_to_fine(count: int) -> Array:
    """Return i / count for 0 < i < count: the middle first, then the middles between those before."""
    order: dict[int, None] = {}
    parts = 2
    while len(order) < count - 1:
        order.update(dict.fromkeys(i * count // parts for i in range(1, parts, 2)))
        order.pop(0, None)
        parts *= 2
    return frozen([i / count for i in order])
