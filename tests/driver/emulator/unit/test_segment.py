"""Queued segments: their limits hold inside a cubic too, and of any order."""

from __future__ import annotations

import numpy as np
import pytest

from driver.emulator.unit.path_generator import PathGenerator
from emulated.queued_segments import SPEED, add, run


@pytest.mark.parametrize("seed", range(4))
def test_cubics_are_fast_inside_too(seed: int) -> None:
    """As fast as the limits allow, with the steepest place inside the segment (a rest-to-rest cubic: in the middle)."""
    rng = np.random.default_rng(seed)
    path = PathGenerator((0,) * 6)
    total = np.zeros(6, dtype=int)
    for _ in range(6):
        d = rng.integers(-6000, 6001, 6)
        add(path, [[0, 3 * int(v), -2 * int(v)] for v in d])
        total += d
    at = run(path)
    assert np.array_equal(at[-1], total)
    velocity = np.abs(np.diff(at, axis=0))
    assert np.all(velocity <= np.array(SPEED) + 1)
    assert np.any(velocity > 0.8 * np.array(SPEED))


def test_order_four_and_more() -> None:
    path = PathGenerator((0,) * 6)
    add(path, [[0, 0, 0, 9000, -7200], *[[0] * 5] * 5], 1000.0)
    assert run(path)[-1][0] == 1800
