"""The clearance to search with: a margin more than asked, if the ends have it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from plan.collision.search_margin import MARGIN, searched_clearance


def _world(distances: list[float]) -> Any:
    """A world in which configuration number i keeps the distance number i, m."""
    return SimpleNamespace(
        in_collision=lambda q, clearance: distances[int(q[0])] < clearance,
        distance=lambda q: SimpleNamespace(value=distances[int(q[0])]),
    )


@pytest.mark.parametrize(
    ("distances", "searched"),
    [
        ([0.1, 0.1], 0.005 + MARGIN),
        ([0.1, 0.0056], 0.0053),  # half of what an end has beyond
        ([0.0052, 0.0056], 0.0051),  # the end that has least
        ([0.1, 0.005], 0.005),
        ([0.1, 0.001], 0.005),  # never less than asked
    ],
)
def test_the_margin_shrinks_to_half_of_what_the_ends_have(distances: list[float], searched: float) -> None:
    ends = [np.array([float(i)]) for i in range(len(distances))]
    assert searched_clearance(_world(distances), ends, 0.005) == pytest.approx(searched, abs=1e-12)
