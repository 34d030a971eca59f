"""Exact extremes of integer segments."""

from __future__ import annotations

import numpy as np

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from plan.trajectory.extremes import segment_extremes


def test_extremes_are_those_of_a_dense_sample(crs97: Unit) -> None:
    rng = np.random.default_rng(5)
    segments = tuple(
        Segment(
            int(rng.integers(40, 200)),
            tuple(tuple(int(c) for c in row) for row in rng.integers(-900, 900, (order, 6))),
        )
        for order in (1, 2, 3, 3, 3, 3, 3, 3)
    )
    path = CountPath((0,) * 6, segments)
    worst, u = segment_extremes(path, crs97), np.linspace(0, 1, 20001)
    for k, segment in enumerate(segments):
        q = crs97.positions(path.knots()[k] + segment.derivative(u, 0))
        np.testing.assert_allclose(worst.lower[k], q.min(axis=0), atol=1e-7)
        np.testing.assert_allclose(worst.upper[k], q.max(axis=0), atol=1e-7)
        scale = np.abs(crs97.counts_per_rad)
        np.testing.assert_allclose(
            worst.velocity[k], np.abs(segment.derivative(u)).max(axis=0) / scale, rtol=1e-6
        )
        np.testing.assert_allclose(
            worst.acceleration[k], np.abs(segment.derivative(u, 2)).max(axis=0) / scale, rtol=1e-6
        )
    join = segments[3].derivative(1.0) - segments[4].derivative(0.0)
    np.testing.assert_allclose(worst.jumps[3], np.abs(join) / np.abs(crs97.counts_per_rad))
