"""Curves of lines and circular arcs in space, exact, by arc length."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.numerics.angles import arccos, arctan2
from arm.numerics.products import mul, norm
from arm.se3 import Array, cross, frozen

SAME = 1e-9  # m; points that are nearer are one
STRAIGHT = 1e-6  # rad; directions that differ by less pass without a corner


@dataclass(frozen=True, eq=False)
class Line:
    """A straight piece from `start` (3,) to `end` (3,), m."""

    start: Array
    end: Array

    @property
    def length(self) -> float:
        """Its length, m."""
        return norm(self.end - self.start)

    def at(self, s: Array) -> Array:
        """Return the points (k, 3) at arc lengths (k,) from its start."""
        return np.asarray(self.start + s[:, None] * self.directions(s))

    def directions(self, s: Array) -> Array:
        """Return the unit directions of travel (k, 3) there."""
        return np.broadcast_to((self.end - self.start) / self.length, (len(s), 3))

    def part(self, begin: float, end: float) -> Line:
        """Return the part between two arc lengths."""
        first, last = self.at(np.array([begin, end]))
        return Line(frozen(first), frozen(last))

    def moved(self, by: Array) -> Line:
        """Return it shifted by a vector (3,), m."""
        return Line(frozen(self.start + by), frozen(self.end + by))

    def backwards(self) -> Line:
        """Return it travelled the other way."""
        return Line(self.end, self.start)

    def distances(self, points: Array) -> Array:
        """Return the distance of each point (k, 3) from it, m."""
        along = np.clip(mul(points - self.start, self.directions(np.zeros(1))[0]), 0.0, self.length)
        return _norms(points - self.at(along))


@dataclass(frozen=True, eq=False)
class Arc:
    """A circular arc of less than a turn, m and rad.

    Attributes:
        centre: (3,), of its circle.
        radius: of its circle.
        outward: (3,), unit vector from the centre to its start.
        ahead: (3,), unit direction of travel at its start; normal to `outward`.
        angle: by which it turns, above 0.
    """

    centre: Array
    radius: float
    outward: Array
    ahead: Array
    angle: float

    @property
    def length(self) -> float:
        """Its length, m."""
        return self.radius * self.angle

    def at(self, s: Array) -> Array:
        """Return the points (k, 3) at arc lengths (k,) from its start."""
        turned = (s / self.radius)[:, None]
        ray = np.cos(turned) * self.outward + np.sin(turned) * self.ahead
        return np.asarray(self.centre + self.radius * ray)

    def directions(self, s: Array) -> Array:
        """Return the unit directions of travel (k, 3) there."""
        turned = (s / self.radius)[:, None]
        return np.asarray(np.cos(turned) * self.ahead - np.sin(turned) * self.outward)

    def part(self, begin: float, end: float) -> Arc:
        """Return the part between two arc lengths."""
        at = np.array([begin])
        outward = (self.at(at)[0] - self.centre) / self.radius
        angle = (end - begin) / self.radius
        return Arc(self.centre, self.radius, frozen(outward), frozen(self.directions(at)[0]), angle)

    def moved(self, by: Array) -> Arc:
        """Return it shifted by a vector (3,), m."""
        return replace(self, centre=frozen(self.centre + by))

    def backwards(self) -> Arc:
        """Return it travelled the other way."""
        last = np.array([self.length])
        outward = (self.at(last)[0] - self.centre) / self.radius
        return Arc(self.centre, self.radius, frozen(outward), frozen(-self.directions(last)[0]), self.angle)

    def distances(self, points: Array) -> Array:
        """Return the distance of each point (k, 3) from it, m."""
        ray = points - self.centre
        turned = np.mod(arctan2(mul(ray, self.ahead), mul(ray, self.outward)), 2.0 * np.pi)
        beside = self.at(self.radius * np.minimum(turned, self.angle))
        ends = self.at(np.array([0.0, self.length]))
        to_ends = np.minimum(_norms(points - ends[0]), _norms(points - ends[1]))
        return np.where(turned <= self.angle, _norms(points - beside), to_ends)


Piece = Line | Arc


@dataclass(frozen=True, eq=False)
class Outline:
    """Lines and arcs, each beginning where the one before ends. Beyond both ends it goes on straight.

    Attributes:
        pieces: at least one.
    """

    pieces: tuple[Piece, ...]

    @property
    def length(self) -> float:
        """Its length, m."""
        return float(self.joints[-1])

    @property
    def joints(self) -> Array:
        """Arc lengths (n + 1,) of its start, of where its n pieces meet, and of its end."""
        return np.concatenate([[0.0], np.cumsum([piece.length for piece in self.pieces])])

    def at(self, s: npt.ArrayLike) -> Array:
        """Return the points (k, 3) at arc lengths (k,)."""
        s = np.asarray(s, dtype=float)
        inside = np.clip(s, 0.0, self.length)
        points, ahead = self._of_pieces(inside)
        return np.asarray(points + (s - inside)[:, None] * ahead)

    def directions(self, s: npt.ArrayLike) -> Array:
        """Return the unit directions of travel (k, 3) there; at a corner, that behind it."""
        return self._of_pieces(np.clip(np.asarray(s, dtype=float), 0.0, self.length))[1]

    def _of_pieces(self, s: Array) -> tuple[Array, Array]:
        joints = self.joints
        piece_of = np.clip(np.searchsorted(joints, s, side="right") - 1, 0, len(self.pieces) - 1)
        points, ahead = np.empty((len(s), 3)), np.empty((len(s), 3))
        for k in np.unique(piece_of):
            here = piece_of == k
            local = s[here] - joints[k]
            points[here], ahead[here] = self.pieces[k].at(local), self.pieces[k].directions(local)
        return points, ahead

    def turns(self) -> Array:
        """Return the angle (n - 1,) by which the direction jumps between successive pieces, rad."""
        ends = [piece.directions(np.array([0.0, piece.length])) for piece in self.pieces]
        jumps = [_angle(before[1], after[0]) for before, after in pairwise(ends)]
        return np.array(jumps)

    def corners(self) -> Array:
        """Return the arc lengths of the places where the direction jumps."""
        return self.joints[1:-1][self.turns() > STRAIGHT]

    def moved(self, by: Array) -> Outline:
        """Return it shifted by a vector (3,), m."""
        return Outline(tuple(piece.moved(by) for piece in self.pieces))

    def backwards(self) -> Outline:
        """Return it travelled the other way."""
        return Outline(tuple(piece.backwards() for piece in reversed(self.pieces)))

    def cut(self, begin: float, end: float) -> Outline:
        """Return the outline between two arc lengths; straight beyond its own ends.

        Raises:
            InputError: nothing is left.
        """
        if end - begin < SAME:
            why = f"nothing is left of a path of {1e3 * self.length:g} mm between {1e3 * begin:g} and {1e3 * end:g} mm"
            raise InputError(why, begin=begin, end=end)
        return Outline(tuple(_merged(self._cut(begin, end))))

    def _cut(self, begin: float, end: float) -> Iterator[Piece]:
        if begin < 0.0:
            yield _line(*self.at([begin, min(end, 0.0)]))
        for piece, at in zip(self.pieces, self.joints, strict=False):
            first, last = max(begin - at, 0.0), min(end - at, piece.length)
            if first < SAME and last > piece.length - SAME:
                yield piece
            elif last - first > SAME:
                yield piece.part(first, last)
        if end > self.length:
            yield _line(*self.at([max(begin, self.length), end]))

    def sampled(self, chord_error: float, longest: float) -> Array:
        """Return arc lengths (m,) with all joints, between which chords leave the curve by at most `chord_error`, m.

        Args:
            chord_error: largest distance of the curve from a chord, m.
            longest: longest step, m.
        """
        found = [np.zeros(1)]
        for piece, begin in zip(self.pieces, self.joints, strict=False):
            step = longest
            if isinstance(piece, Arc):  # the sagitta of a chord is r (1 - cos(angle / 2))
                half = arccos(1.0 - chord_error / piece.radius) if chord_error < piece.radius else np.pi / 2
                step = min(step, 2.0 * float(half) * piece.radius)
            count = max(int(np.ceil(piece.length / step - 1e-9)), 1)
            found.append(begin + piece.length * np.arange(1, count + 1) / count)
        return np.concatenate(found)


def through(points: Sequence[npt.ArrayLike]) -> Outline:
    """Return the lines through points (n, 3), m.

    Raises:
        InputError: fewer than two, or two that follow each other are one.
    """
    at = [frozen(point) for point in points]
    if len(at) < 2:
        raise InputError(f"a path has {len(at)} points; must have at least two", count=len(at))
    return Outline(tuple(line(a, b) for a, b in pairwise(at)))


def line(start: npt.ArrayLike, end: npt.ArrayLike) -> Line:
    """Return the line between two points.

    Raises:
        InputError: they are one.
    """
    made = _line(np.asarray(start, dtype=float), np.asarray(end, dtype=float))
    if made.length < SAME:
        raise InputError(f"two points of a path are the same, {_mm(made.start)}", point=made.start.tolist())
    return made


def arc_about(start: npt.ArrayLike, centre: npt.ArrayLike, end: npt.ArrayLike, within: float = 1e-4) -> Arc:
    """Return the shorter arc from `start` to `end` about a centre (3,).

    Args:
        start, end: its ends, (3,) m.
        centre: of its circle; moved such that the circle passes through both ends.
        within: largest difference of the distances of both ends from the given centre, m.

    Raises:
        InputError: the distances differ, or the ends lie opposite each other, so that the plane is not known.
    """
    start, end, centre = (np.asarray(v, dtype=float) for v in (start, end, centre))
    chord: Array = end - start
    radii = norm(start - centre), norm(end - centre)
    if abs(radii[0] - radii[1]) > within:
        why = (
            f"the arc's ends are {1e3 * radii[0]:.3f} and {1e3 * radii[1]:.3f} mm from its centre {_mm(centre)}; "
            f"must be equal within {1e3 * within:g} mm"
        )
        raise InputError(why, radii=radii)
    if min(radii) <= within:
        why = f"the arc's centre {_mm(centre)} is at its ends; it must be at least {1e3 * within:g} mm from them"
        raise InputError(why, radii=radii)
    if norm(chord) < SAME:
        raise InputError(f"the arc's ends are the same point, {_mm(start)}", point=start.tolist())
    middle = (start + end) / 2.0
    towards = middle - centre
    ahead = chord / norm(chord)
    towards = towards - mul(towards, ahead) * ahead
    if norm(towards) < 1e-3 * radii[0]:
        why = "the arc turns by 180 deg, so its plane is not known; give a point that it passes (through_mm)"
        raise InputError(why, radii=radii)
    centre = middle - towards  # the nearest point from which both ends are equally far
    outward = (start - centre) / norm(start - centre)
    ahead = ahead - mul(ahead, outward) * outward
    rays: Array = np.stack([start - centre, end - centre])
    angle = _angle(rays[0], rays[1])
    return Arc(frozen(centre), norm(start - centre), frozen(outward), frozen(ahead / norm(ahead)), angle)


def arc_through(start: npt.ArrayLike, via: npt.ArrayLike, end: npt.ArrayLike) -> Arc:
    """Return the arc from `start` through `via` to `end`, (3,) m each.

    Raises:
        InputError: they lie on a line.
    """
    start, via, end = (np.asarray(v, dtype=float) for v in (start, via, end))
    a, b = via - start, end - start
    normal = cross(a, b)
    if norm(normal) < 1e-6 * norm(a) * norm(b) or min(norm(a), norm(b), norm(end - via)) < SAME:
        why = f"an arc's three points {_mm(start)}, {_mm(via)}, {_mm(end)} lie on a line"
        raise InputError(why, points=[start.tolist(), via.tolist(), end.tolist()])
    # centre of the circle through three points (circumcentre)
    to_centre = (mul(a, a) * cross(b, normal) - mul(b, b) * cross(a, normal)) * 0.5 / mul(normal, normal)
    centre, radius = start + to_centre, norm(to_centre)
    outward = -to_centre / radius
    ahead = cross(normal / norm(normal), outward)
    ray = end - centre
    angle = float(np.mod(arctan2(mul(ray, ahead), mul(ray, outward)), 2.0 * np.pi))
    return Arc(frozen(centre), radius, frozen(outward), frozen(ahead), angle)


def _merged(pieces: Iterator[Piece]) -> Iterator[Piece]:
    """Join lines that go on in the same direction, so that a longer line stays one piece."""
    before: Piece | None = None
    for piece in pieces:
        if isinstance(before, Line) and isinstance(piece, Line):
            ahead = [one.directions(np.zeros(1))[0] for one in (before, piece)]
            if _angle(*ahead) <= STRAIGHT:
                before = Line(before.start, piece.end)
                continue
        if before is not None:
            yield before
        before = piece
    if before is not None:
        yield before


def _line(start: Array, end: Array) -> Line:
    return Line(frozen(start), frozen(end))


def _angle(a: Array, b: Array) -> float:
    return float(arctan2(norm(cross(a, b)), float(mul(a, b))))


def _norms(v: Array) -> Array:
    return np.asarray(np.sqrt((v * v).sum(axis=-1)))


def _mm(point: Array) -> str:
    return f"({', '.join(f'{1e3 * float(v):g}' for v in point)})"
