"""The least signed distance of a circle from the core of a body, to within a proven error.

The circle is cut into arcs, whose ends are measured. Where no point of an arc can be nearer than the nearest one that
was measured, less the error, the arc is settled; the others are cut further (branch and bound).

Let an arc have the angle w, the ends a and b at distances s_a and s_b, a chord of length L, and the middle direction e
from the centre. Its points are those of the chord, moved along e by 0 to R (1 - cos(w / 2)), the bulge.

- The signed distance from a convex core is a convex function, so it lies above its tangent planes at both ends. On the
  chord it is then no lower than min(s_a, s_b) or, if it falls from both ends, than the crossing of two lines. On the
  arc it is lower by no more than the bulge times the larger of -e . g_a and -e . g_b, g the gradients; by nothing for
  a circle that encloses the body.
- The squared distance of a point p from the circle of a torus, with radius Q about the z axis, is
  p . p + Q^2 - 2 Q |p_xy|. On the chord p . p is at most L^2 / 4 below the line through its ends, and -|p_xy| is
  concave, so above that line. The distance on the chord is at least sqrt(min(s_a, s_b)^2 - L^2 / 4), and on the arc
  lower by no more than the bulge.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, pi, sin

import numpy as np

from arm.se3 import Array, Indices
from plan.collision.narrow.solids import Solids

ERROR = 2e-7  # m, of the least distance, in addition to that of the distances of points
_FIRST, _FINER = 32, 8  # parts of the circle, and of each arc that is open
_LEVELS = 8  # the last arcs are shorter than 1e-7 of their radius


@dataclass(frozen=True, eq=False)
class Circles:
    """k circles, each in the frame of a body.

    Attributes:
        centre: (3, k) m.
        x, y: (3, k) m, from the centre to points of the circle, at right angles.
        radius: (k,) m.
        body: (k,) index of the body.
    """

    centre: Array
    x: Array
    y: Array
    radius: Array
    body: Indices


@dataclass(frozen=True, eq=False)
class Nearest:
    """Points of k circles that are nearest to the cores of their bodies.

    Attributes:
        distance: (k,) m.
        point: (3, k) m.
        away: (3, k), gradient of the distance there: a unit vector away from the body.
    """

    distance: Array
    point: Array
    away: Array


def nearest(circles: Circles, solids: Solids, limits: Array | None = None) -> Nearest:
    """Return the points of circles that are nearest to their bodies.

    Args:
        circles: k circles.
        solids: their bodies.
        limits: (k,) m. If given, the search ends with the first distance below its limit. Then, or if there is none,
            distances are upper bounds, and there are no points.
    """
    count = len(circles.body)
    found = Nearest(np.full(count, inf), np.zeros((3, count)), np.zeros((3, count)))
    error = ERROR + solids.error
    # of each open arc: its circle, and the half axes with x to where it begins
    of, x, y = np.arange(count), circles.x, circles.y
    for cosine, sine, half_angle in _TABLES:
        spokes = x[..., None] * cosine + y[..., None] * sine
        points = circles.centre[:, of, None] + spokes
        value, gradient = solids.measure(circles.body[of], points)
        if limits is None:
            _improve(found, of, value, points, gradient)
            enough = found.distance - error
        else:
            np.minimum.at(found.distance, of, value.min(axis=1))
            if (found.distance < limits).any():
                break
            enough = np.minimum(found.distance - error, limits)
        lower, convex = _from_convex(value, spokes, gradient, half_angle), solids.convex[circles.body[of]]
        if not convex.all():
            lower = np.where(convex[:, None], lower, _from_torus(value, circles.radius[of], half_angle))
        arc, part = np.nonzero(lower < enough[of, None])
        if not len(arc):
            break
        of, (cos_part, sin_part) = of[arc], (cosine[part], sine[part])
        x, y = x[:, arc] * cos_part + y[:, arc] * sin_part, y[:, arc] * cos_part - x[:, arc] * sin_part
    return found


def _improve(found: Nearest, of: Indices, value: Array, points: Array, gradient: Array) -> None:
    """Keep the nearest of the points (3, o, n) of each circle."""
    place = value.argmin(axis=1)
    arc = np.arange(len(of))
    least, before = value[arc, place], found.distance[of]
    np.minimum.at(found.distance, of, least)
    better = np.flatnonzero((least < before) & (least == found.distance[of]))
    found.point[:, of[better]] = points[:, better, place[better]]
    found.away[:, of[better]] = gradient[:, better, place[better]]


def _from_convex(value: Array, spokes: Array, gradient: Array, half_angle: float) -> Array:
    """Return lower bounds (o, n) m of the distance of o arcs in n parts from convex cores.

    Args:
        value: (o, n + 1) m, at the ends of the parts.
        spokes: (3, o, n + 1) m, from the centre of the circle to these.
        gradient: (3, o, n + 1).
        half_angle: of a part, rad.
    """
    own = (gradient * spokes).sum(axis=0)
    ahead = (gradient[..., :-1] * spokes[..., 1:]).sum(axis=0)
    back = (gradient[..., 1:] * spokes[..., :-1]).sum(axis=0)
    fall, rise = ahead - own[:, :-1], own[:, 1:] - back  # along the chord, from its ends
    a, b = value[:, :-1], value[:, 1:]
    valley = (fall < 0.0) & (rise > 0.0)
    crossing = a + fall * (b - a - rise) / np.where(valley, fall - rise, 1.0)
    lower = np.minimum(a, b)
    np.minimum(lower, crossing, out=lower, where=valley)
    # the sum of two spokes is 2 R cos(half_angle) e
    outwards = np.minimum(own[:, :-1] + ahead, own[:, 1:] + back)
    return np.asarray(lower + (1.0 - cos(half_angle)) / (2.0 * cos(half_angle)) * np.minimum(outwards, 0.0))


def _from_torus(value: Array, radius: Array, half_angle: float) -> Array:
    """Return lower bounds (o, n) m of the distance of parts of circles of `radius` (o,) m from circles of tori."""
    lower, half_chord = np.minimum(value[:, :-1], value[:, 1:]), radius[:, None] * sin(half_angle)
    on_chord = np.sqrt(np.maximum(lower * lower - half_chord * half_chord, 0.0))
    return np.asarray(on_chord - radius[:, None] * (1.0 - cos(half_angle)))


def _table(level: int) -> tuple[Array, Array, float]:
    """Return cosines and sines of the ends of the parts of an arc, and half the angle of a part."""
    parts = _FINER if level else _FIRST
    angle = 2.0 * pi / (_FIRST * _FINER**level)
    turns = [part * angle for part in range(parts + 1)]
    return np.array([cos(a) for a in turns]), np.array([sin(a) for a in turns]), angle / 2.0


_TABLES = [_table(level) for level in range(_LEVELS)]
