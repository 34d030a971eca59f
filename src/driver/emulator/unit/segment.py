"""A queued segment of coordinated motion: a polynomial of all axes in a parameter u from 0 to 1.

Source: docs/sources.md, "Coordinated motion", row 3: counts(u) = start + a1 u + a2 u^2 + .. .
"""

from __future__ import annotations

import math
from collections.abc import Sequence

_SAMPLES = 64  # of the derivative, above order 3


class QueuedSegment:
    """A segment with the limits of its parameter's rate; times in ms, positions in the unit's counts.

    Args:
        start: counts at u = 0.
        coefficients: one row a1, a2, .. per axis (axis-major, as on the wire).
        least_ms: shortest time; 0: as fast as the limits allow.
        speed: limit of each axis, counts/ms.
        acceleration: limit of each axis, counts/ms^2.
        number: the unit's number of the segment.

    Attributes:
        end: counts at u = 1, integers.
        rate: highest du/dt, 1/ms, by `least_ms` and the axes' speeds.
        gain: highest change of the rate, 1/ms^2, by the axes' accelerations (the path's curvature is not taken into
            account, row 15). Infinite if nothing moves.
        leave: presently planned rate at u = 1 (the backward pass raises it as segments arrive).
        vertex: highest rates before and after the vertex at u = 0, with the segment before.
    """

    __slots__ = (
        "acceleration", "end", "end_slope", "gain", "leave", "number", "poly", "rate", "start", "start_slope",
        "vertex",
    )  # fmt: skip

    def __init__(
        self,
        start: tuple[int, ...],
        coefficients: Sequence[Sequence[int]],
        least_ms: float,
        speed: Sequence[float],
        acceleration: Sequence[float],
        number: int,
    ) -> None:
        self.start = start
        self.poly = tuple(tuple(reversed(row)) for row in coefficients)  # highest power first, for Horner
        self.end = tuple(s + sum(row) for s, row in zip(start, coefficients, strict=True))
        self.start_slope = tuple(float(row[0]) for row in coefficients)
        self.end_slope = tuple(float(sum(p * a for p, a in enumerate(row, 1))) for row in coefficients)
        steepest = [_steepest(row) for row in coefficients]
        self.rate = min(
            1.0 / least_ms if least_ms > 0.0 else math.inf,
            *(v / m for v, m in zip(speed, steepest, strict=True) if m > 0.0),
            math.inf,
        )
        self.gain = min(
            (a / m for a, m in zip(acceleration, steepest, strict=True) if m > 0.0), default=math.inf
        )
        self.acceleration = tuple(acceleration)
        self.number = number
        self.leave = self.rest_rate(self.end_slope)
        self.vertex = (0.0, self.rest_rate(self.start_slope))

    def at(self, u: float) -> tuple[int, ...]:
        """Return the counts at u, rounded; exactly `end` at 1."""
        if u >= 1.0:
            return self.end
        counts = []
        for start, row in zip(self.start, self.poly, strict=True):
            value = 0.0
            for a in row:
                value = (value + a) * u
            counts.append(start + math.floor(value + 0.5))
        return tuple(counts)

    def rest_rate(self, slope: Sequence[float]) -> float:
        """Return the highest rate at an end with that slope that counts as rest: one acceleration step of 1 ms."""
        return min(
            self.rate, *(a / abs(s) for a, s in zip(self.acceleration, slope, strict=True) if s), math.inf
        )


def _steepest(row: Sequence[int]) -> float:
    """max |a1 + 2 a2 u + 3 a3 u^2 + ..| over u in [0, 1]; exact up to order 3, sampled above."""
    if len(row) > 3:
        return max(
            abs(sum(p * a * (i / _SAMPLES) ** (p - 1) for p, a in enumerate(row, 1)))
            for i in range(_SAMPLES + 1)
        )
    a1, a2, a3 = (*row, 0, 0)[:3]
    candidates = [float(abs(a1)), float(abs(a1 + 2 * a2 + 3 * a3))]
    if a3 and 0.0 < (turn := -a2 / (3.0 * a3)) < 1.0:
        candidates.append(abs(a1 + 2 * a2 * turn + 3 * a3 * turn * turn))
    return max(candidates)
