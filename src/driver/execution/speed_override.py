"""The speed override: exactly the same path, in more time."""

from __future__ import annotations

import math
from dataclasses import replace

from arm.controller.segments import CountPath


def stretched_ms(duration_ms: int, override: float) -> int:
    """Return the duration of a segment at `override` (0 to 1) of its planned speed, rounded up to whole ms."""
    return math.ceil(duration_ms / override - 1e-9)


def stretched(path: CountPath, override: float) -> CountPath:
    """Return the path at `override` (0 to 1) of its planned speed: longer segments with the same coefficients.

    So the arm passes the same counts as certified. Velocities decrease by at least the factor, and accelerations inside
    segments by at least its square. Rounding each segment up to whole ms changes the speed at a vertex by less than one
    part in the segment's ms; if that is too much, the unit slows down there by itself.
    """
    if override >= 1.0:
        return path
    segments = tuple(replace(s, duration_ms=stretched_ms(s.duration_ms, override)) for s in path.segments)
    return CountPath(path.start, segments)
