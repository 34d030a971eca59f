"""Shortcuts: never slower, free at samples, and from the same start to the same goal."""

from __future__ import annotations

import numpy as np
import pytest

from arm.se3 import Array
from plan.trajectory.time_estimates import path_time
from plan.transit.edges import SampledEdges
from plan.transit.rrt_connect import RrtConnect
from plan.transit.shortcuts import shortened, without_needless_corners
from plans.transits import LEFT, LIMITS, LOW_WALL, RIGHT, world_with


def time(path: Array) -> float:
    return path_time(path, LIMITS)


@pytest.mark.parametrize("seed", range(5))
def test_paths_get_shorter_and_stay_free(seed: int) -> None:
    edges = SampledEdges(world_with(LOW_WALL).too_near(0.011), 0.1)
    path = RrtConnect(LIMITS, edges, np.random.default_rng(seed)).search(RIGHT, LEFT, 3000)
    assert path is not None
    none, some = (
        shortened(path, edges, LIMITS, time, np.random.default_rng(seed), attempts) for attempts in (0, 60)
    )
    for short in (none, some):
        assert np.array_equal(short[[0, -1]], path[[0, -1]])
        assert SampledEdges(edges.too_near, 0.1).path_clear(short)
    assert time(some) < time(none) <= time(path) + 1e-9
    # a shortcut that saves nothing is not taken
    same = shortened(path, edges, LIMITS, lambda path: 1.0, np.random.default_rng(seed), 60)
    assert np.array_equal(same, none)


def test_only_needed_corners_stay() -> None:
    """The first joint must not pass 0.5 unless the second is above 1."""
    edges = SampledEdges(lambda q: bool(abs(q[0] - 0.5) < 0.1 and q[1] < 1.0), 0.05)
    path = np.array([[0.0, 0.0], [0.1, 0.5], [0.2, 1.2], [0.4, 1.3], [0.8, 1.2], [0.9, 0.3], [1.0, 0.0]])
    kept = without_needless_corners(path, edges)
    assert len(kept) == 4
    assert edges.path_clear(kept)
