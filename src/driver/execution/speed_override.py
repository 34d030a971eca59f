"""The velocity override: the same path, to the count, in more time."""

from __future__ import annotations

import math
from dataclasses import replace

from arm.controller.segments import CountPath


def stretched_ms(duration_ms: int, override: float) -> int:
    """Duration of a segment at `override` (0 to 1) of its planned speed, whole ms, never shorter than asked for."""
    return math.ceil(duration_ms / override - 1e-9)


def stretched(path: CountPath, override: float) -> CountPath:
    """The path at `override` (0 to 1) of its planned speed: longer segments of the same coefficients.

    So the counts that are passed are those of the certificate. Velocities are lower by the factor or more, and
    accelerations inside segments by its square or more. Rounding each segment up to whole ms on its own changes the
    speed at a vertex by less than one part in the segment's ms; the unit slows down there itself if that is too much.
    """
    if override >= 1.0:
        return path
    segments = tuple(replace(s, duration_ms=stretched_ms(s.duration_ms, override)) for s in path.segments)
    return CountPath(path.start, segments)
