"""Pairs of circular arcs with a common tangent (biarcs): they round corners and follow smooth curves.

Source: K. Bolton, "Biarc curves", Computer-Aided Design 7, 1975; here in space, with tangents of equal length.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from arm.errors import InputError
from arm.numerics.angles import arctan2
from arm.numerics.products import mul, norm
from arm.se3 import Array, frozen
from cell.program.outline import SAME, STRAIGHT, Arc, Line, Outline, Piece

SHARPEST = np.radians(170.0)  # a corner with a larger turn is not rounded
_HALVINGS = 50  # of an interval, when a length is searched for
_DEEPEST = 12  # halvings of a curve's parameter
_ACROSS = 17  # samples of a piece at which distances are taken


def biarc(start: Array, ahead: Array, end: Array, ahead_end: Array) -> tuple[Piece, ...]:
    """Return one or two pieces from a point to another that begin and end in given unit directions, (3,) each."""
    chord = end - start
    along, square, turn = float(mul(chord, ahead + ahead_end)), float(mul(chord, chord)), 0.0
    turn = 1.0 - float(mul(ahead, ahead_end))
    # tangents of length d meet in the middle: |chord - d (ahead + ahead_end)| = 2 d
    if turn > 1e-12:
        d = (np.sqrt(along * along + 2.0 * turn * square) - along) / (2.0 * turn)
    else:
        d = square / (2.0 * along) if along > SAME else 0.0
    middle = (start + end + d * (ahead - ahead_end)) / 2.0
    first, second = _arc(start, ahead, middle), _arc(end, -ahead_end, middle).backwards()
    return tuple(piece for piece in (first, second) if piece.length > SAME)


def _arc(start: Array, ahead: Array, end: Array) -> Piece:
    """Return the arc, or line, that begins in a direction and reaches a point."""
    chord = end - start
    aside = chord - mul(chord, ahead) * ahead
    square = float(mul(chord, chord))
    if norm(aside) <= STRAIGHT * np.sqrt(square):
        return Line(frozen(start), frozen(end))
    inward = aside / norm(aside)
    radius = square / (2.0 * norm(aside))
    angle = 2.0 * float(arctan2(norm(aside), float(mul(chord, ahead))))
    return Arc(frozen(start + radius * inward), radius, frozen(-inward), frozen(ahead), angle)


def rounded(outline: Outline, deviation: float) -> Outline:
    """Return the outline with its corners rounded by arcs that stay within `deviation`, m, of it.

    A rounding takes at most half of a piece between two corners. Corners sharper than 170 deg stay.
    """
    if deviation <= 0.0:
        return outline
    turns = outline.turns()
    is_corner = np.concatenate([[False], (turns > STRAIGHT) & (turns < SHARPEST), [False]])
    lengths = [piece.length for piece in outline.pieces]
    shares = [length / max(int(is_corner[k]) + int(is_corner[k + 1]), 1) for k, length in enumerate(lengths)]
    begins, ends, blends = [0.0] * len(lengths), list(lengths), dict[int, tuple[Piece, ...]]()
    for k in np.flatnonzero(is_corner).tolist():
        before, after = outline.pieces[k - 1], outline.pieces[k]
        cut, blend = _rounding(before, after, min(shares[k - 1], shares[k]), deviation)
        ends[k - 1], begins[k], blends[k] = lengths[k - 1] - cut, cut, blend
    return Outline(tuple(_joined(outline, begins, ends, blends)))


def _joined(
    outline: Outline, begins: list[float], ends: list[float], blends: dict[int, tuple[Piece, ...]]
) -> Iterator[Piece]:
    for k, piece in enumerate(outline.pieces):
        yield from blends.get(k, ())
        if begins[k] == 0.0 and ends[k] == piece.length:
            yield piece
        elif ends[k] - begins[k] > SAME:
            yield piece.part(begins[k], ends[k])


def _rounding(before: Piece, after: Piece, most: float, deviation: float) -> tuple[float, tuple[Piece, ...]]:
    """Return how much of both pieces is cut off at their common corner, m, and what replaces it."""
    low, high, best = 0.0, most, most
    for _ in range(_HALVINGS):
        if _deviation(before, after, best) <= deviation:
            low = best
            if low == most:
                break
        else:
            high = best
        best = (low + high) / 2.0
    return low, _blend(before, after, low)


def _blend(before: Piece, after: Piece, cut: float) -> tuple[Piece, ...]:
    first, last = np.array([before.length - cut]), np.array([cut])
    return biarc(
        before.at(first)[0], before.directions(first)[0], after.at(last)[0], after.directions(last)[0]
    )


def _deviation(before: Piece, after: Piece, cut: float) -> float:
    """Largest distance of a rounding from the corner's two pieces, and of the corner from the rounding, m."""
    blend = _blend(before, after, cut)
    points = np.concatenate([piece.at(np.linspace(0.0, piece.length, _ACROSS)) for piece in blend])
    off = float(np.minimum(before.distances(points), after.distances(points)).max())
    corner = after.at(np.zeros(1))
    return max(off, float(min(piece.distances(corner)[0] for piece in blend)))


def arcs_along(
    point: Callable[[float], Array], direction: Callable[[float], Array], tolerance: float
) -> tuple[Piece, ...]:
    """Return lines and arcs that follow a smooth curve, with its points and directions at their joints.

    Args:
        point: of the curve at a parameter from 0 to 1, (3,) m.
        direction: unit direction there, (3,).
        tolerance: largest distance of the curve from them, at samples, m.

    Raises:
        InputError: the curve turns too often to be followed so closely.
    """
    return tuple(_follow(point, direction, tolerance, 0.0, 1.0, 0))


def _follow(
    point: Callable[[float], Array],
    direction: Callable[[float], Array],
    tolerance: float,
    begin: float,
    end: float,
    depth: int,
) -> Iterator[Piece]:
    pieces = biarc(point(begin), direction(begin), point(end), direction(end))
    between = np.linspace(begin, end, 7)[1:-1]
    points = np.array([point(float(u)) for u in between])
    if depth >= 1:
        # without pieces its ends are one point
        away = [piece.distances(points) for piece in pieces] or [
            np.sqrt(((points - point(begin)) ** 2).sum(axis=1))
        ]
        off = float(np.min(away, axis=0).max())
        if off <= tolerance and (pieces or depth == _DEEPEST):
            yield from pieces
            return
        if depth == _DEEPEST:
            raise InputError(
                f"the curve is {1e3 * off:.3g} mm from {2**_DEEPEST} pairs of arcs (allowed: {1e3 * tolerance:g} mm); "
                "divide it, or draw it with fewer turns",
                off_m=off,
            )
    middle = (begin + end) / 2.0
    yield from _follow(point, direction, tolerance, begin, middle, depth + 1)
    yield from _follow(point, direction, tolerance, middle, end, depth + 1)
