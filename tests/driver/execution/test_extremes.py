"""How far a path of cubic segments goes, against a dense sampling."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from driver.execution.extremes import extremes
from wire.soft_home import SOFT_HOME


@pytest.mark.parametrize("seed", range(20))
def test_extremes_bound_a_dense_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = [tuple(tuple(int(c) for c in r) for r in rng.integers(-3000, 3000, (3, 6))) for _ in range(4)]
    path = CountPath(SOFT_HOME, tuple(Segment(100, r) for r in rows))
    low, high = extremes(path)
    dense = path.sample(1e-4)
    assert (dense >= low - 1e-6).all()
    assert (dense <= high + 1e-6).all()
    assert (dense.min(axis=0) - low).max() < 3.0
    assert (high - dense.max(axis=0)).max() < 3.0
