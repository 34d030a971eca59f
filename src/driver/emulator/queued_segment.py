"""One polynomial of the coordinated queue, with the limits on how fast its parameter may run.

q(u) = start + a1 u + .. + an u^n with u from 0 to 1 (fact sheet, section 2, row 3). The planner works on the rate
r = du/dt, in 1/ms. Over a cell of the parameter, r is bounded by the segment's least time and by each axis' speed
over its steepest slope in the cell, and dr/dt by each axis' acceleration over that slope (rows 10-12).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from arm.se3 import Array

_CELL_MS = 5.0  # wanted length of a cell
_FEWEST_CELLS, _MOST_CELLS = 16, 128
_FASTEST_RATE = 1.0  # 1/ms: a segment takes at least one tick
_FASTEST_CHANGE = 10.0  # 1/ms^2, where no axis moves


@dataclass(frozen=True)
class AxisLimits:
    """Limits of the group's axes when a segment is queued; later changes of registers do not reach it.

    Attributes:
        speed: counts/ms, (n,).
        acceleration: counts/ms^2, (n,).
        vertex_steps: COORDDISCONT, speed jump allowed at a vertex in acceleration steps of 1 ms.
    """

    speed: Array
    acceleration: Array
    vertex_steps: int


@dataclass(eq=False)
class QueuedSegment:
    """A segment in the queue; made by `queue_segment`, its envelope kept by the planner.

    Attributes:
        sequence: the unit's number of it.
        start, end: counts, (n,).
        coefficients: a1, a2, .. as rows, (order, n) counts.
        limits: that it runs under.
        cells: of the parameter.
        rate_cap: most rate in each cell, 1/ms.
        change_cap: most change of rate in each cell, 1/ms^2.
        slope_in, slope_out: dq/du at both ends, (n,).
        rest_in, rest_out: rates at its ends that one tick can start from rest or bring to rest, 1/ms.
        ratio: rate after the vertex at its start over the rate before it; 0 if it starts from rest.
        vertex_rate: most rate of the segment before, at that vertex.
        envelope: square of the most rate at the cells' borders, from which all that follows can still be obeyed.
    """

    sequence: int
    start: npt.NDArray[np.int64]
    end: npt.NDArray[np.int64]
    coefficients: Array
    limits: AxisLimits
    cells: int
    rate_cap: list[float]
    change_cap: list[float]
    slope_in: Array
    slope_out: Array
    rest_in: float
    rest_out: float
    ratio: float = 0.0
    vertex_rate: float = 0.0
    envelope: list[float] = field(default_factory=list)

    def positions(self, u: list[float]) -> Array:
        """Counts at parameters (m,); (m, n)."""
        at = np.array(u)[:, None]
        total = np.zeros((len(u), len(self.start)))
        for row in self.coefficients[::-1]:
            total = (total + row) * at
        return np.asarray(self.start + total)


def queue_segment(
    sequence: int,
    start: npt.NDArray[np.int64],
    coefficients: npt.NDArray[np.int64],
    duration_ms: int,
    limits: AxisLimits,
    curvature_limited: bool = False,
) -> QueuedSegment:
    """Work out the limits of a segment.

    Args:
        sequence: number it gets.
        start: counts, (n,).
        coefficients: (order, n) counts.
        duration_ms: least duration; 0 is as fast as the limits allow.
        limits: of the axes.
        curvature_limited: the rate is also kept where q'' r^2 stays inside the acceleration.
    """
    order = len(coefficients)
    a = coefficients.astype(float)
    powers = np.arange(1, order + 1)[:, None]
    cells = 1
    if order > 1:
        cells = (
            int(np.clip(duration_ms / _CELL_MS, _FEWEST_CELLS, _MOST_CELLS)) if duration_ms else _MOST_CELLS
        )
    borders = np.linspace(0.0, 1.0, cells + 1)
    slopes = _derivative(a, 1, borders)
    third = np.sum(np.abs(a * powers * (powers - 1) * (powers - 2)), axis=0)
    # Linear interpolation between two borders errs by at most h^2/8 of the slope's own second derivative.
    steepest = np.maximum(np.abs(slopes[:-1]), np.abs(slopes[1:])) + third / (8.0 * cells**2)
    bends = np.abs(_derivative(a, 2, borders))
    longest = 1.0 / duration_ms if duration_ms else _FASTEST_RATE
    with np.errstate(divide="ignore"):
        rate = np.minimum(np.min(limits.speed / steepest, axis=1), min(longest, _FASTEST_RATE))
        change = np.minimum(np.min(limits.acceleration / steepest, axis=1), _FASTEST_CHANGE)
        if curvature_limited:
            bend = np.maximum(bends[:-1], bends[1:])
            rate = np.minimum(rate, np.sqrt(np.min(limits.acceleration / bend, axis=1)))
    return QueuedSegment(
        sequence=sequence,
        start=start,
        end=start + coefficients.sum(axis=0),
        coefficients=a,
        limits=limits,
        cells=cells,
        rate_cap=rate.tolist(),
        change_cap=change.tolist(),
        slope_in=slopes[0],
        slope_out=slopes[-1],
        rest_in=_rest_rate(slopes[0], bends[0], limits.acceleration),
        rest_out=_rest_rate(slopes[-1], bends[-1], limits.acceleration),
    )


def join(before: QueuedSegment, after: QueuedSegment) -> None:
    """Set the vertex rule between two segments on the second: speed is kept, each axis' jump is bounded.

    Speed is compared in a norm where each axis counts in units of its own acceleration, so for a smooth join the
    rates are those of one continuous motion. Every axis' jump stays below the vertex steps: |dv| <= n a 1 ms.
    """
    acceleration, steps = after.limits.acceleration, after.limits.vertex_steps
    leaving = float(np.linalg.norm(before.slope_out / acceleration))
    entering = float(np.linalg.norm(after.slope_in / acceleration))
    if steps == 0 or leaving == 0.0 or entering == 0.0:
        after.ratio, after.vertex_rate = 0.0, before.rest_out
        return
    after.ratio = leaving / entering
    jump = np.abs(before.slope_out - after.ratio * after.slope_in)
    with np.errstate(divide="ignore"):
        after.vertex_rate = float(np.min(np.minimum(steps * acceleration / jump, _FASTEST_RATE)))


def _derivative(a: Array, order: int, u: Array) -> Array:
    """Derivative by u of sum a_p u^p at (m,) parameters; (m, n)."""
    total = np.zeros((len(u), a.shape[1]))
    for power, row in enumerate(a, start=1):
        if power >= order:
            factor = float(np.prod(np.arange(power - order + 1, power + 1)))
            total += factor * u[:, None] ** (power - order) * row
    return total


def _rest_rate(slope: Array, bend: Array, acceleration: Array) -> float:
    """Rate at which a tick from rest leaves every axis at no more than half an acceleration step.

    After one tick at rate r the speed is at most (|q'| + |q''| r) r; half, because the tick itself may accelerate.
    """
    root = slope**2 + 2.0 * bend * acceleration
    with np.errstate(divide="ignore"):
        rates = acceleration / (np.abs(slope) + np.sqrt(root))
    return float(min(np.min(rates), _FASTEST_RATE))
