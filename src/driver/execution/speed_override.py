"""The speed override: exactly the same path, in more time."""

from __future__ import annotations

import math
from dataclasses import replace

from arm.controller.segments import CountPath


def stretched(path: CountPath, override: float) -> CountPath:
    """Return the path at `override` (0 to 1) of its planned speed: longer segments with the same coefficients.

    So the arm passes the same counts as certified. Velocities decrease by at least the factor, and accelerations inside
    segments by at least its square. Durations are rounded up to whole ms, which changes the speed at a vertex by less
    than 1 / (the segment's ms). If the unit does not allow that change, it slows down there by itself.
    """
    if override >= 1.0:
        return path
    stretched_ms = (math.ceil(s.duration_ms / override - 1e-9) for s in path.segments)
    segments = (replace(s, duration_ms=ms) for s, ms in zip(path.segments, stretched_ms, strict=True))
    return CountPath(path.start, tuple(segments))
