"""Geometry of joint paths, without time: piecewise polynomials q(s) with continuous direction.

A path is a `scipy.interpolate.PPoly` over s with values (n,): `path(s)`, `path(s, 1)`, `path(s, 2)`. The second
derivative may jump at `path.x`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline, PPoly

from arm.controller.unit import Limits
from arm.errors import InputError
from arm.se3 import Array, frozen
from plan.cartesian.line import JointPath

Path = Any  # scipy.interpolate.PPoly; scipy has no types

_SAME = 1e-9  # rad, distance below which way-points count as one
_ROUNDS = 60  # iterations in which blend durations and the corners that they move converge


@dataclass(frozen=True, eq=False)
class Chained:
    """Alternating lines and transits as one path over nominal time tau, see `chained`.

    Attributes:
        path: over tau in s, with continuous first derivative.
        edges: (parts + 1,) tau where each part begins, and the end.
        caps: (pieces,) largest d tau/dt that the tool speed allows in each piece of the path; inf without a cap.
    """

    path: Path
    edges: Array
    caps: Array


@dataclass(frozen=True, eq=False)
class Stretch:
    """A line in a chain, and the cap on its speed (unit of the line's s, per s), or None."""

    path: JointPath
    tool_speed: float | None = None


def polyline(q: npt.ArrayLike) -> Path:
    """Connect way-points q (m, n) by straight pieces with sharp corners; s is the distance in joint space, rad.

    Raises:
        InputError: fewer than two different way-points.
    """
    points = _distinct(q)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    return PPoly(np.stack([np.diff(points, axis=0) / lengths[:, None], points[:-1]]), s)


def _distinct(q: npt.ArrayLike) -> Array:
    points = np.atleast_2d(np.asarray(q, dtype=float))
    keep = np.ones(len(points), dtype=bool)
    keep[1:] = np.linalg.norm(np.diff(points, axis=0), axis=1) > _SAME
    points = points[keep]
    if len(points) < 2:
        raise InputError("a path needs two different way-points", count=len(points))
    return np.asarray(points)


def chained(parts: Sequence[Stretch | npt.ArrayLike], limits: Limits, blend: float = 1.0) -> Chained:
    """Join alternating lines and transits into one path without stops.

    The parameter tau is nominal time. At rate 1, the fastest joint moves at its velocity limit on every straight piece,
    and a line is followed at its `tool_speed` or as fast as its joints allow. Parabolas in tau round the corners
    (linear segments with parabolic blends: J. Craig, "Introduction to Robotics", 2005, section 7.3); each is as long as
    the change of velocity takes under the acceleration limits. Lines stay unchanged: the corner at the end of a line is
    moved along its tangent by half a blend, so that the blend begins where the line ends.

    Args:
        parts: lines, and transits as way-points (m, n) rad from the end of the line before to the start of the next. A
            path that begins or ends with a transit is at rest there.
        limits: limits of velocity and acceleration.
        blend: in (0, 1], factor on the duration of each blend; a smaller one stays nearer to the way-points and is
            slower.

    Raises:
        InputError: two lines or two transits follow each other, fewer than two different way-points, lines that do not
            meet them, `blend` or a tool speed out of range.
    """
    if not 0.0 < blend <= 1.0:
        raise InputError(f"blend = {blend:g}: must be above 0 and at most 1", value=blend)
    straight = [isinstance(part, Stretch) for part in parts]
    if any(a == b for a, b in pairwise(straight)) or not parts:
        raise InputError("a chain must alternate between lines and transits", parts=len(parts))
    transits = [None if isinstance(part, Stretch) else _distinct(part) for part in parts]
    # what is before and after part i has the indices i and i + 2 between two that are not there
    beside = [None, *transits, None]
    lines = [
        _line(part, beside[i], beside[i + 2], limits) if isinstance(part, Stretch) else None
        for i, part in enumerate(parts)
    ]
    around, found = [None, *lines, None], list[_Part]()
    for i, (points, line) in enumerate(zip(transits, lines, strict=True)):
        if points is not None:
            found.append(_transit(points, around[i], around[i + 2], limits, blend))
        elif line is not None:
            found.append(line)
    starts = np.concatenate([[0.0], np.cumsum([float(part.path.x[-1]) for part in found])])
    x = np.concatenate([[0.0], *(b + part.path.x[1:] for b, part in zip(starts, found, strict=False))])
    path = PPoly(np.concatenate([_cubic(part.path.c) for part in found], axis=1), x)
    caps = np.concatenate([np.full(part.path.c.shape[1], part.cap) for part in found])
    return Chained(path, frozen(starts), frozen(caps))


@dataclass(frozen=True, eq=False)
class _Part:
    path: Path
    cap: float


def _cubic(c: Array) -> Array:
    return np.concatenate([np.zeros((4 - len(c), *c.shape[1:])), c])


def _line(stretch: Stretch, before: Array | None, after: Array | None, limits: Limits) -> _Part:
    """Return a line over its nominal time; it must meet the way-points (m, n) of the transits before and after it."""
    line, tool_speed = stretch.path, stretch.tool_speed
    if not (tool_speed is None or tool_speed > 0.0):
        raise InputError(f"speed cap = {tool_speed:g}: must be positive", value=float(tool_speed))
    for name, points, met, end in (("after", before, -1, 0), ("before", after, 0, -1)):
        off = 0.0 if points is None else float(np.abs(line.q[end] - points[met]).max())
        if off > 1e-6:
            why = f"line {name}: ends {off:.3g} rad from the transit's way-point: must meet it to 1e-6 rad"
            raise InputError(why, off_rad=off)
    path = CubicSpline(line.s - line.s[0], line.q)
    x = path.x
    places = np.linspace(x[:-1], x[1:], 3).ravel()
    with np.errstate(divide="ignore"):
        able = float((limits.velocity / np.abs(path(places, 1)).max(axis=0)).min())
    factor = able if tool_speed is None else min(able, tool_speed)
    scale = factor ** np.arange(len(path.c) - 1, -1, -1)
    cap = np.inf if tool_speed is None else tool_speed / factor
    return _Part(PPoly(path.c * scale[:, None, None], x / factor), cap)


def _transit(points: Array, before: _Part | None, after: _Part | None, limits: Limits, blend: float) -> _Part:
    """Return straight pieces and blends through points, between lines or from and to rest."""
    enter = None if before is None else before.path(before.path.x[-1], 1)
    leave = None if after is None else after.path(after.path.x[0], 1)
    time = np.zeros(len(points))  # of the blend at each point, s; those at the ends join the lines
    for turn in range(_ROUNDS):
        lines = _lines(points, enter, leave, limits, time)
        wanted = blend * (np.abs(lines.change) / limits.acceleration).max(axis=1)
        wanted[1:] = np.minimum(wanted[1:], lines.span)
        wanted[:-1] = np.minimum(wanted[:-1], lines.span)
        wanted[wanted < 1e-9] = 0.0
        if np.abs(wanted - time).max() <= 1e-12 * lines.span.max():
            break
        # in the second half of the rounds durations may only shrink, so that they converge
        time = wanted if turn < _ROUNDS // 2 else np.minimum(wanted, time)
    lines = _lines(points, enter, leave, limits, time)
    while (lines.room(time) < -1e-12 * lines.span).any():
        time = 0.9 * time
        lines = _lines(points, enter, leave, limits, time)
    pieces: list[tuple[float, Array]] = []
    for i, (corner, velocity, change) in enumerate(
        zip(lines.corners, lines.velocities[:-1], lines.change, strict=True)
    ):
        if time[i] > 0.0:
            start = corner - velocity * (time[i] / 2)
            pieces.append((float(time[i]), np.stack([change / (2 * time[i]), velocity, start])))
        if i < len(lines.span) and lines.room(time)[i] > 1e-9:
            onward = lines.velocities[i + 1]
            start = corner + onward * (time[i] / 2)
            pieces.append((float(lines.room(time)[i]), np.stack([0.0 * onward, onward, start])))
    x = np.concatenate([[0.0], np.cumsum([length for length, _ in pieces])])
    return _Part(PPoly(np.stack([c for _, c in pieces], axis=1), x), np.inf)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Straight lines through corners (m, n) with durations `span` (m - 1,) s, and velocities (m + 1, n).

    The first and last velocity are those before and after the transit.
    """

    corners: Array
    span: Array
    velocities: Array

    @property
    def change(self) -> Array:
        """Change of velocity at each corner, (m, n)."""
        return np.asarray(np.diff(self.velocities, axis=0))

    def room(self, time: Array) -> Array:
        """Return the duration of each straight line that is left between blends, s."""
        return np.asarray(self.span - (time[:-1] + time[1:]) / 2)


def _lines(points: Array, enter: Array | None, leave: Array | None, limits: Limits, time: Array) -> _Lines:
    """Return the lines whose corners are rounded by blends of these durations; enter and leave move the end corners."""
    corners = points.copy()
    if enter is not None:
        corners[0] = points[0] + enter * (time[0] / 2)
    if leave is not None:
        corners[-1] = points[-1] - leave * (time[-1] / 2)
    steps = np.diff(corners, axis=0)
    span = np.maximum((np.abs(steps) / limits.velocity).max(axis=1), 1e-9)
    velocity = steps / span[:, None]
    ends = (velocity[0] if enter is None else enter, velocity[-1] if leave is None else leave)
    return _Lines(corners, span, np.concatenate([ends[0][None], velocity, ends[1][None]]))
