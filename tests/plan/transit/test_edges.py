"""Sampled edges: every sample is looked at once, and what is free is kept."""

from __future__ import annotations

import numpy as np
import pytest

from arm.se3 import Array
from plan.transit.edges import SampledEdges, coarse_to_fine


@pytest.mark.parametrize("count", [1, 2, 3, 7, 8, 33, 100])
def test_every_inner_sample_comes_once(count: int) -> None:
    order = coarse_to_fine(count)
    assert sorted(order) == [i / count for i in range(1, count)]


def test_the_middle_comes_first_and_gaps_are_halved() -> None:
    assert coarse_to_fine(8)[:3].tolist() == [0.5, 0.25, 0.75]
    for count in (50, 64):
        for looked in (3, 7, 15):
            some = np.sort([0.0, *coarse_to_fine(count)[:looked], 1.0])
            assert np.diff(some).max() <= 1.0 / (looked + 1) + 1.5 / count


def band(low: float, high: float) -> SampledEdges:
    """Blocked where the first joint is between two values."""

    def too_near(q: Array) -> bool:
        return bool(low < q[0] < high)

    return SampledEdges(too_near, 0.1)


def test_a_line_is_clear_if_all_its_samples_are() -> None:
    a, b = np.array([0.0, 0.0]), np.array([1.0, -1.0])  # 20 samples, 0.05 rad of the first joint each
    assert band(2.0, 3.0).clear(a, b)
    for i in range(1, 20):
        assert not band(i / 20 - 0.01, i / 20 + 0.01).clear(a, b)
        assert band(i / 20 - 0.01, i / 20 + 0.01).blocked(a, b) == pytest.approx(i / 20)
    assert band(0.51, 0.54).clear(a, b)  # between samples: they prove nothing
    assert not band(-0.1, 0.1).path_clear(np.stack([b, a, b]))  # a corner counts
    assert band(-0.1, 0.04).path_clear(np.stack([a, b]))  # ends do not


def test_a_blocked_line_is_followed_up_to_what_blocks_it() -> None:
    a, b = np.array([0.0, 0.0]), np.array([1.0, -1.0])
    passed, reached = band(0.52, 0.7).advance(a, b)
    assert not reached
    assert np.allclose(passed, [[x, -x] for x in np.arange(0.05, 0.52, 0.05)])
    passed, reached = band(2.0, 3.0).advance(a, b)
    assert reached
    assert np.array_equal(passed[-1], b)
    assert band(-1.0, 2.0).advance(a, b) == ([], False)
