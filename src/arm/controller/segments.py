"""Motion as the controller executes it: polynomial segments in encoder counts and milliseconds.

A segment is one ``COORDSPLINET``: counts(u) = start + a1 u + a2 u^2 + a3 u^3 with u from 0 to 1 over its duration
(docs/sources.md, "Coordinated motion", row 3). All numbers are integers, so the checked, stored and sent motions are
the same to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from arm.controller.unit import Counts
from arm.errors import InputError
from arm.se3 import Array


@dataclass(frozen=True)
class Segment:
    """One polynomial segment of all axes.

    Attributes:
        duration_ms: shortest duration; the controller may take longer, but it stays on the path.
        coefficients: a1, a2, .. as rows of six counts; 1 row is a straight line, 3 rows a cubic.
    """

    duration_ms: int
    coefficients: tuple[tuple[int, ...], ...]

    def end(self) -> Counts:
        """Return the displacement over the whole segment, (6,) counts."""
        return np.asarray(np.array(self.coefficients, dtype=np.int64).sum(axis=0), dtype=np.int64)

    def derivative(self, u: float | Array, order: int = 1) -> Array:
        """Return the time derivative of this order at the planned duration, counts/s^order.

        Args:
            u: parameter, scalar or (m,); the result is (6,) or (m, 6).
            order: 0 for the counts from the segment's start.
        """
        u = np.asarray(u, dtype=float)[..., None]
        total = np.zeros((*u.shape[:-1], len(self.coefficients[0])))
        for power, row in enumerate(self.coefficients, start=1):
            if power >= order:
                factor = float(np.prod(np.arange(power - order + 1, power + 1)))
                total += factor * u ** (power - order) * np.array(row, dtype=float)
        return total / (self.duration_ms / 1e3) ** order


@dataclass(frozen=True)
class CountPath:
    """A chain of segments from a start in counts.

    Attributes:
        start: (6,) counts.
        segments: in order; each starts where the previous one ends.
    """

    start: tuple[int, ...]
    segments: tuple[Segment, ...]

    @property
    def duration_s(self) -> float:
        """Planned duration, s."""
        return sum(s.duration_ms for s in self.segments) / 1e3

    def knots(self) -> Counts:
        """Return the counts at the start of every segment and at the end, (n + 1, 6), read-only."""
        return self._knots

    @cached_property
    def _knots(self) -> Counts:
        steps = [np.array(self.start, dtype=np.int64), *(s.end() for s in self.segments)]
        knots = np.cumsum(np.stack(steps), axis=0)
        knots.flags.writeable = False
        return knots

    def knot_times(self) -> Array:
        """Return the planned time of every knot, (n + 1,) s from the start."""
        return np.concatenate([[0.0], np.cumsum([s.duration_ms for s in self.segments]) / 1e3])

    @property
    def has_velocity_jumps(self) -> bool:
        """Whether any segment is a straight line or takes no time, so that the velocity jumps at its ends."""
        return any(len(s.coefficients) == 1 or s.duration_ms <= 0 for s in self.segments)

    @property
    def end(self) -> tuple[int, ...]:
        """Counts at the end, (6,)."""
        return tuple(int(c) for c in self.knots()[-1])

    def cubics(self) -> Array:
        """Return a1, a2 and a3 of every segment, (3, segments, 6); the order is at most 3."""
        a = np.zeros((3, len(self.segments), len(self.start)))
        for k, segment in enumerate(self.segments):
            a[: len(segment.coefficients), k] = segment.coefficients
        return a

    def extremes(self) -> tuple[Counts, Counts]:
        """Return the lowest and highest counts of every axis, at and between knots, (6,) each, rounded outwards."""
        low, high = self.knots()[:-1] + cubic_position_range(self.cubics())
        return np.floor(low.min(axis=0)).astype(np.int64), np.ceil(high.max(axis=0)).astype(np.int64)

    def sample(self, step_s: float = 1e-3) -> Array:
        """Return counts (m, 6), not rounded, on a regular time grid that includes both ends."""
        times = np.arange(0.0, self.duration_s + step_s / 2, step_s)
        return self.at(np.minimum(times, self.duration_s))

    def at(self, times: Sequence[float] | Array) -> Array:
        """Return counts (m, 6), not rounded, at times (m,) in s from the start, clamped to the motion."""
        if not self.segments:
            return np.tile(np.array(self.start, dtype=float), (len(times), 1))
        lasts = np.array([s.duration_ms for s in self.segments]) / 1e3
        ends = self.knot_times()[1:]
        clamped = np.clip(np.asarray(times, dtype=float), 0.0, ends[-1])
        i = np.minimum(np.searchsorted(ends, clamped, side="right"), len(ends) - 1)
        with np.errstate(divide="ignore", invalid="ignore"):  # a segment may take no time
            u = np.where(lasts[i] > 0.0, (clamped - (ends[i] - lasts[i])) / lasts[i], 1.0)
        u, a = np.clip(u, 0.0, 1.0)[:, None], self.cubics()
        steps = a.sum(axis=0)
        starts = np.array(self.start) + np.cumsum(steps, axis=0) - steps
        return np.asarray(starts[i] + sum(u**power * row[i] for power, row in enumerate(a, start=1)))


def cubic_position_range(a: Array) -> Array:
    """Return the smallest and largest a1 u + a2 u^2 + a3 u^3 over u in [0, 1], (2, ...); a is (3, ...)."""
    # roots of a1 + 2 a2 u + 3 a3 u^2; NaN if there are none
    half = -(a[1] + np.copysign(np.sqrt(np.maximum(a[1] ** 2 - 3 * a[2] * a[0], 0.0)), a[1]))
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = np.stack([half / (3 * a[2]), a[0] / half])
    roots = np.where(np.isfinite(roots), np.clip(roots, 0.0, 1.0), 0.0)
    values = roots * (a[0] + roots * (a[1] + roots * a[2]))
    every = np.concatenate([values, np.zeros((1, *a.shape[1:])), a.sum(axis=0)[None]])
    return np.stack([every.min(axis=0), every.max(axis=0)])


def chain(paths: Sequence[CountPath]) -> CountPath:
    """Concatenate paths.

    Raises:
        InputError: there are no paths, or a path does not start at the counts where the previous one ends.
    """
    if not paths:
        raise InputError("a chain needs at least one path", count=0)
    for number, (before, after) in enumerate(pairwise(paths), start=1):
        if before.end != after.start:
            why = f"path {number} of the chain starts at {after.start}, but the previous one ends at {before.end}"
            raise InputError(why, path=number, start=list(after.start), end=list(before.end))
    return CountPath(paths[0].start, tuple(s for path in paths for s in path.segments))
