"""Shortcuts of paths: corners are removed, and random places joined by straight lines, if all samples are free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.transit.edges import SampledEdges

_WORTH = 1e-3  # s, least useful gain of a shortcut


def shortened(
    path: Array,
    edges: SampledEdges,
    limits: Limits,
    time: Callable[[Array], float],
    rng: np.random.Generator,
    attempts: int,
) -> Array:
    """Return a path (m, n) with fewer corners that takes no longer; samples of its new lines are free.

    Args:
        path: way-points (m, n) rad.
        edges: checks of new lines.
        limits: joint limits; places on the path are uniform over the travel time at the velocity limits.
        time: estimates the duration of a path, s.
        rng: source of all random choices.
        attempts: number of random shortcuts that are tried.
    """
    path = without_needless_corners(path, edges)
    best = time(path)
    for _ in range(attempts):
        if len(path) < 3:
            break
        trial = _shortcut(path, limits, rng)
        if trial is None:
            continue
        joined, a, b = trial
        taken = time(joined)
        if taken < best - _WORTH and edges.clear(a, b):
            path, best = joined, taken
    return without_needless_corners(path, edges)


def without_needless_corners(path: Array, edges: SampledEdges) -> Array:
    """Return the path with each way-point joined to the farthest one that a free straight line reaches."""
    kept = [0]
    while kept[-1] < len(path) - 1:
        at, to = kept[-1], len(path) - 1
        while to > at + 1 and not edges.clear(path[at], path[to]):
            to -= 1
        kept.append(to)
    return path[kept]


def _shortcut(path: Array, limits: Limits, rng: np.random.Generator) -> tuple[Array, Array, Array] | None:
    """Return the path cut short between two random places, and these places; None if both are on one line."""
    passed = np.cumsum((np.abs(np.diff(path, axis=0)) / limits.velocity).max(axis=1))
    places = np.sort(rng.uniform(0.0, passed[-1], 2))
    i, j = (min(int(k), len(passed) - 1) for k in np.searchsorted(passed, places, side="right"))
    if i == j:
        return None
    begin = np.concatenate([[0.0], passed])[[i, j]]
    u, v = (places - begin) / (passed[[i, j]] - begin)
    a = path[i] + u * (path[i + 1] - path[i])
    b = path[j] + v * (path[j + 1] - path[j])
    return np.concatenate([path[: i + 1], [a, b], path[j + 1 :]]), a, b
