"""Proof of a path edge by edge; an edge that cannot be proved gets another way-point where the proof failed."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.collision.world import World
from plan.transit.edges import SampledEdges

_DEEPEST = 3  # an edge is divided at most this often
_ATTEMPTS = 24  # way-points that are tried for one edge
_PROVED = 3  # of them, those that are clear at samples and whose proof is tried
_OFFSET = 0.02  # rad, by which the standard deviation of a way-point from its edge grows with each attempt


class PathProof:
    """Proves paths in one world.

    Args:
        world: bodies to avoid.
        limits: joint limits of new way-points.
        clearance: required, m.
        edges: checks of new edges at finer samples, with the clearance of the search.
        rng: source of all random choices.
    """

    def __init__(
        self, world: World, limits: Limits, clearance: float, edges: SampledEdges, rng: np.random.Generator
    ) -> None:
        self.world, self.limits, self.clearance = world, limits, clearance
        self.edges, self.rng = edges, rng

    def mended(self, path: Array) -> Array | None:
        """Return the path (m, n) with further way-points such that every edge is certified; None if one stays open."""
        whole = certify_curve(self.world, curve_of_waypoints(path), self.clearance)
        if whole.proved:
            return path
        parts = [path[:1]]
        for a, b in pairwise(path):
            inner = self._edge(a, b, _DEEPEST)
            if inner is None:
                return None
            parts.append(inner)
        return np.concatenate(parts)

    def _edge(self, a: Array, b: Array, depth: int) -> Array | None:
        """Return certified way-points (m, n) from a (excluded) to b, or None."""
        check = certify_curve(self.world, curve_of_waypoints([a, b]), self.clearance)
        if check.proved:
            return b[None]
        if not depth:
            return None
        middle, tried = a + np.clip(check.time, 0.1, 0.9) * (b - a), 0
        for attempt in range(1, _ATTEMPTS + 1):
            drawn = middle + attempt * _OFFSET * self.rng.normal(size=len(a))
            q = np.clip(drawn, self.limits.lower, self.limits.upper)
            if not self.edges.path_clear(np.stack([a, q, b])):
                continue
            first = self._edge(a, q, depth - 1)
            second = None if first is None else self._edge(q, b, depth - 1)
            if first is not None and second is not None:
                return np.concatenate([first, second])
            tried += 1
            if tried >= _PROVED:
                return None
        return None
