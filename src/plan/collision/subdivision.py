"""Subdivision of a chain of cubics into ever shorter intervals (see `plan.collision.certificate`)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

from arm.numerics.products import mul
from arm.se3 import Array, Bools, Indices
from plan.collision.bezier import Curve

# The first pieces have about this travel, rad summed over the joints; there are at most _FIRST_PIECES.
_FIRST_TRAVEL = 0.2
_FIRST_PIECES = 32
# Parts that an unproved cubic, or part of one, is cut into; four are faster than two, because there are fewer rounds.
_PARTS_OF_A_CUBIC = 4


@dataclass(frozen=True, eq=False)
class CurveIntervals:
    """m intervals (pieces) of the curve: runs of whole cubics, and parts of one cubic.

    Attributes:
        first, last: (m,) indices of the cubics that each interval covers, `last` excluded.
        begin, end: (m,) where each begins and ends, in cubics from the start of the curve.
        middle: (m, n) configuration in the middle of each.
        reach: (m, n) largest motion of each joint from the middle.
        control: (m, 4, n) control points of a part; the two ends of a run, twice.
        spread: (m, n) largest deviation of each joint from the hull of `control`; 0 for a part.
        bound: (m,) lower bound on the distance of the open pairs, m.
        open: (m, p) True for pairs that are not proved yet.
    """

    first: Indices
    last: Indices
    begin: Array
    end: Array
    middle: Array
    reach: Array
    control: Array
    spread: Array
    bound: Array
    open: Bools

    def __len__(self) -> int:
        return len(self.first)

    def runs(self) -> Bools:
        """Return flags (m,): True for an interval of several cubics."""
        return np.asarray(self.last - self.first > 1)

    def cuts(self) -> Array:
        """Return where the middle of each is, in cubics from the start of the curve."""
        run = self.first + (self.last - self.first) // 2
        return np.where(self.runs(), run, (self.begin + self.end) / 2.0)

    def where(self, rows: Bools) -> CurveIntervals:
        """Return the intervals with a flag in `rows` (m,)."""
        return CurveIntervals(*(getattr(self, name)[rows] for name in _PARTS))

    def and_(self, more: CurveIntervals) -> CurveIntervals:
        """Return these intervals followed by `more`."""
        return CurveIntervals(
            *(np.concatenate([getattr(self, name), getattr(more, name)]) for name in _PARTS)
        )


_PARTS = tuple(field.name for field in fields(CurveIntervals))


class CurveSubdivision:
    """Cuts a curve into intervals."""

    def __init__(self, curve: Curve) -> None:
        self.control = curve.control
        self.low, self.high = curve.control.min(axis=1), curve.control.max(axis=1)

    def first_pieces(self, pairs: int) -> CurveIntervals:
        """Return the whole curve as a few pieces of about the same travel; all of the `pairs` pairs are open."""
        count = len(self.control)
        travel = float((self.high - self.low).sum())
        wanted = int(np.clip(np.ceil(travel / _FIRST_TRAVEL), 1, _FIRST_PIECES))
        edges = np.unique(np.linspace(0, count, min(wanted, count) + 1).astype(np.intp))
        m = len(edges) - 1
        pieces = self.covering(edges[:-1], edges[1:], np.full(m, -np.inf), np.ones((m, pairs), dtype=bool))
        if wanted < 2 * count:
            return pieces
        return _split(pieces, 1 << ((wanted // count).bit_length() - 1))

    def covering(self, first: Indices, last: Indices, bound: Array, open_: Bools) -> CurveIntervals:
        """Return runs of whole cubics."""
        control = self.control[first]
        middle, reach = _about_middle(control)
        spread = np.zeros_like(middle)
        for i in np.flatnonzero(last - first > 1).tolist():
            middle[i], reach[i], control[i], spread[i] = self._run(int(first[i]), int(last[i]))
        begin, end = first.astype(float), last.astype(float)
        return CurveIntervals(first, last, begin, end, middle, reach, control, spread, bound, open_)

    def _run(self, first: int, last: int) -> tuple[Array, Array, Array, Array]:
        """Return middle, reach, control points and spread of several cubics."""
        middle = self.control[first + (last - first) // 2, 0]
        low, high = self.low[first:last].min(axis=0), self.high[first:last].max(axis=0)
        begin, end = self.control[first, 0], self.control[last - 1, 3]
        points, chord = self.control[first:last].reshape(-1, len(middle)), end - begin
        along = np.clip(mul(points - begin, chord) / max(float(mul(chord, chord)), 1e-18), 0.0, 1.0)
        spread = np.abs(points - begin - along[:, None] * chord).max(axis=0)
        return middle, np.maximum(high - middle, middle - low), np.stack([begin, end, begin, end]), spread

    def finer(self, pieces: CurveIntervals) -> CurveIntervals:
        """Cut runs in two, and single cubics (or parts of one) into equal parts."""
        runs = pieces.runs()
        made = []
        if not runs.all():
            made.append(_split(pieces.where(~runs), _PARTS_OF_A_CUBIC))
        if runs.any():
            some = pieces.where(runs)
            at = some.cuts().astype(np.intp)
            first = np.stack([some.first, at], axis=1).ravel()
            last = np.stack([at, some.last], axis=1).ravel()
            bound, open_ = np.repeat(some.bound, 2), np.repeat(some.open, 2, axis=0)
            made.append(self.covering(first, last, bound, open_))
        return made[0] if len(made) == 1 else made[0].and_(made[1])


def _split(parts: CurveIntervals, count: int) -> CurveIntervals:
    """Cut parts of single cubics into `count` each, a power of 2."""
    control = (mul(_split_matrix(count), parts.control[:, None])).reshape(-1, *parts.control.shape[1:])
    middle, reach = _about_middle(control)
    edges = parts.begin[:, None] + (parts.end - parts.begin)[:, None] * (np.arange(count + 1) / count)
    first, last = np.repeat(parts.first, count), np.repeat(parts.last, count)
    return CurveIntervals(
        first,
        last,
        edges[:, :-1].ravel(),
        edges[:, 1:].ravel(),
        middle,
        reach,
        control,
        np.zeros_like(middle),
        np.repeat(parts.bound, count),
        np.repeat(parts.open, count, axis=0),
    )


def _about_middle(control: Array) -> tuple[Array, Array]:
    """Return the middles (m, n) of cubics (m, 4, n), and the largest motion (m, n) of each joint from there."""
    middle = (control[:, 0] + 3.0 * (control[:, 1] + control[:, 2]) + control[:, 3]) / 8.0
    return middle, np.abs(control - middle[:, None]).max(axis=1)


@lru_cache(maxsize=8)
def _split_matrix(count: int) -> Array:
    """Return matrices (count, 4, 4) from the control points of a cubic to those of its equal parts."""
    if count == 1:
        return np.eye(4)[None]
    # de Casteljau at the middle
    left = np.array([[8, 0, 0, 0], [4, 4, 0, 0], [2, 4, 2, 0], [1, 3, 3, 1]]) / 8.0
    right = left[::-1, ::-1]
    finer = _split_matrix(count // 2)
    return np.concatenate([mul(finer, left), mul(finer, right)])
