"""Exact extremes of position, velocity and acceleration of integer polynomial segments, without sampling.

In a cubic, the position is extreme at an end or where the first derivative (a quadratic) vanishes, the velocity at an
end or where the second derivative (linear) vanishes, and the acceleration at an end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.segments import CountPath, cubic_position_range
from arm.controller.unit import Unit
from arm.errors import InputError
from arm.se3 import Array


@dataclass(frozen=True)
class SegmentExtremes:
    """Extremes of k segments of n joints.

    Attributes:
        lower, upper: (k, n) smallest and largest position, rad.
        velocity: (k, n) largest magnitude, rad/s.
        acceleration: (k, n) largest magnitude, rad/s^2.
        jumps: (k - 1, n) magnitude of the jump of velocity where segments join, rad/s.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    jumps: Array


def segment_extremes(path: CountPath, unit: Unit) -> SegmentExtremes:
    """Return the extremes of every segment of a motion at its planned durations.

    Raises:
        InputError: a segment has an order above 3, or no duration.
    """
    for k, segment in enumerate(path.segments):
        if len(segment.coefficients) > 3 or segment.duration_ms <= 0:
            raise InputError(
                f"segment {k}: order {len(segment.coefficients)}, {segment.duration_ms} ms; must be of order 1 to 3 "
                "and longer than 0 ms",
                segment=k,
            )
    a = path.cubics()
    duration = np.array([s.duration_ms for s in path.segments], dtype=float)[:, None] / 1e3
    ends = (path.knots()[:-1] + cubic_position_range(a) - unit.counts_at_zero) / unit.counts_per_rad
    return SegmentExtremes(
        ends.min(axis=0), ends.max(axis=0), *cubic_peaks(a, duration, np.abs(unit.counts_per_rad))
    )


def cubic_peaks(a: Array, duration: Array, scale: Array | float = 1.0) -> tuple[Array, Array, Array]:
    """Return `SegmentExtremes.velocity`, `acceleration` and `jumps` of cubics.

    Args:
        a: coefficients a1, a2, a3, (3, k, n).
        duration: (k, 1) s.
        scale: of the coefficients, in counts per rad (m), (n,); 1 if they are in rad (m).
    """
    last = a[0] + 2 * a[1] + 3 * a[2]  # a1 + 2 a2 u + 3 a3 u^2 at u = 1
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = -a[1] / (3 * a[2])
    turn = np.where(np.isfinite(turn), np.clip(turn, 0.0, 1.0), 0.0)
    speed = np.abs(np.stack([a[0], last, a[0] + turn * (2 * a[1] + turn * 3 * a[2])])).max(axis=0)
    push = np.maximum(np.abs(2 * a[1]), np.abs(2 * a[1] + 6 * a[2]))
    jumps = np.abs(last[:-1] / duration[:-1] - a[0, 1:] / duration[1:])
    return speed / duration / scale, push / duration**2 / scale, jumps / scale
