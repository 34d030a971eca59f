"""Smooth paths of Hermite cubics."""

from __future__ import annotations

import numpy as np

from arm.controller.segments import CountPath, Segment
from wire.soft_home import SOFT_HOME


def wave(
    segments: int, start: tuple[int, ...] = SOFT_HOME, duration_ms: int = 100, seed: int = 1
) -> CountPath:
    """A smooth motion as Hermite cubics with whole coefficients, from rest to rest."""
    rng = np.random.default_rng(seed)
    amplitude = rng.uniform(-4000, 4000, 6)
    t = np.linspace(0.0, 1.0, segments + 1)
    shape = t**2 * (3 - 2 * t)
    slope = 6 * t * (1 - t) / segments
    knots = np.rint(np.array(start) + np.outer(shape, amplitude)).astype(int)
    cubics = []
    for k in range(segments):
        d = knots[k + 1] - knots[k]
        v0, v1 = np.rint(slope[k] * amplitude).astype(int), np.rint(slope[k + 1] * amplitude).astype(int)
        a3 = v0 + v1 - 2 * d
        a2 = d - v0 - a3
        cubics.append(Segment(duration_ms, tuple(tuple(int(c) for c in row) for row in (v0, a2, a3))))
    return CountPath(start, tuple(cubics))
