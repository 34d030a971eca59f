"""Joint motions as chains of Bézier cubics, the form in which clearance is certified.

A cubic stays in the convex hull of its four Bernstein control points (G. Farin, "Curves and Surfaces for CAGD", 2002,
chapters 4 and 5).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.arguments import numbers, shown
from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import InputError
from arm.se3 import Array


@dataclass(frozen=True)
class Curve:
    """A joint motion as a chain of cubics.

    Attributes:
        control: Bernstein control points of each cubic, (m, 4, n) rad.
        ends: time at the end of each cubic, (m,) s; the path parameter if the motion is not timed.
    """

    control: Array
    ends: Array


def curve_of_counts(path: CountPath, unit: Unit) -> Curve:
    """Return the motion that the controller executes for integer segments."""
    a1, a2, a3 = path.cubics() if path.segments else np.zeros((3, 1, len(path.start)))
    start = path.knots()[: len(a1)]
    control = np.stack(
        [start, start + a1 / 3.0, start + (2.0 * a1 + a2) / 3.0, start + (a1 + a2 + a3)], axis=1
    )
    ends = np.cumsum([s.duration_ms for s in path.segments] or [0]) / 1e3
    return Curve(unit.positions(control), ends)


def curve_of_waypoints(waypoints: npt.ArrayLike) -> Curve:
    """Connect way-points (m, n) rad by straight lines in joint space; line i ends at parameter i + 1.

    Raises:
        InputError: fewer than two way-points, another shape than (m, n), or a number that is not finite.
    """
    q = numbers(waypoints)
    if q is None or q.ndim != 2 or len(q) < 2 or not q.shape[1]:
        raise InputError(
            f"waypoints = {shown(waypoints if q is None else q)}: must be (m, n), two or more rows of one number per "
            "joint, rad; for a single configuration use World.distance",
            name="waypoints",
        )
    bad = np.flatnonzero(~np.isfinite(q).all(axis=1))
    if len(bad):
        why = f"waypoints[{bad[0]}] = {q[bad[0]].tolist()}: must be finite numbers, rad"
        raise InputError(why, name="waypoints", row=int(bad[0]))
    fractions = np.array([0.0, 1.0, 2.0, 3.0])[:, None] / 3.0
    control = q[:-1, None, :] + (q[1:] - q[:-1])[:, None, :] * fractions
    return Curve(control, np.arange(1.0, len(q)))


def curve_of_path(path: Any) -> Curve:
    """Return a piecewise polynomial (scipy PPoly of order at most 3) as a chain of cubics."""
    c = np.zeros((4, *path.c.shape[1:]))
    c[4 - len(path.c) :] = path.c
    h = np.diff(path.x)[:, None]
    a0, a1, a2, a3 = c[3], c[2] * h, c[1] * h**2, c[0] * h**3
    control = np.stack([a0, a0 + a1 / 3, a0 + (2 * a1 + a2) / 3, a0 + a1 + a2 + a3], axis=1)
    return Curve(control, path.x[1:] - path.x[0])
