"""The same path in more time: it passes the same counts, and nothing gets faster."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from driver.execution.control import LEAST_OVERRIDE, Control
from driver.execution.speed_override import stretched
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from wire.controlled_stream import moved, run


@pytest.mark.parametrize("override", [0.7, 0.33, LEAST_OVERRIDE])
def test_an_override_stretches_time_and_keeps_the_path_to_the_count(
    mars: Mars, fake: Any, override: float
) -> None:
    path = run(20, 90)
    sent = stream(mars, path, control=Control(override))
    assert [s.coefficients for s in sent.path.segments] == [s.coefficients for s in path.segments]
    for line, segment in zip(moved(fake), sent.path.segments, strict=True):
        ms, order, *values = (int(v) for v in line.split(":")[1].split(","))
        assert 90 / override <= ms < 90 / override + 1
        assert (ms, order) == (segment.duration_ms, 3)
        assert tuple(tuple(values[i::3]) for i in range(3)) == segment.coefficients
    assert sent.end_counts == path.end
    assert sent.duration_s >= path.duration_s / override - 0.05  # this unit has a line as soon as it is sent
    assert sent.ahead_s <= max(1.5, 0.4 + 2 * max(s.duration_ms for s in sent.path.segments) / 1e3)


def test_an_override_of_one_is_the_path_itself(mars: Mars) -> None:
    assert stretched(run(5), 1.0) == run(5)


@pytest.mark.parametrize("seed", range(5))
def test_an_override_only_lowers(seed: int, unit: Unit) -> None:
    """Random smooth cubics: velocity by the factor, acceleration by its square, and vertices by the unit's rule."""
    rng = np.random.default_rng(seed)
    times = np.cumsum([0, *rng.integers(20, 140, 60)]) / 1e3
    w = rng.uniform(0.3, 1.2, 6)
    amplitude = (
        0.8
        * np.minimum(  # of sines that stay within the registers
            unit.limits().velocity / w, unit.limits().acceleration / w**2
        )
        * np.abs(unit.counts_per_rad)
    )
    at = np.rint(amplitude * np.sin(np.outer(times, w))).astype(int)
    slope = amplitude * w * np.cos(np.outer(times, w))
    segments = []
    for k, (a, b) in enumerate(pairwise(times)):
        v0, v1, d = np.rint(slope[k] * (b - a)), np.rint(slope[k + 1] * (b - a)), at[k + 1] - at[k]
        rows = (v0, 3 * d - 2 * v0 - v1, v0 + v1 - 2 * d)
        segments.append(Segment(round(1e3 * (b - a)), tuple(tuple(int(c) for c in row) for row in rows)))
    path = CountPath(tuple(int(c) for c in at[0]), tuple(segments))
    override = float(rng.uniform(0.05, 0.99))
    slow = stretched(path, override)
    step = 5e-3 * unit.limits().acceleration * np.abs(unit.counts_per_rad)  # COORDDISCONT:5
    for before, after in zip(path.segments, slow.segments, strict=True):
        for u in (0.0, 0.3, 1.0):
            assert (np.abs(after.derivative(u)) <= override * np.abs(before.derivative(u)) + 1e-9).all()
            assert (
                np.abs(after.derivative(u, 2)) <= override**2 * np.abs(before.derivative(u, 2)) + 1e-6
            ).all()
    for one, two in pairwise(slow.segments):
        assert (np.abs(one.derivative(1.0) - two.derivative(0.0)) <= step).all()
