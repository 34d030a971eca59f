"""Time-optimal path parametrisation under symmetric velocity and acceleration limits, by reachability analysis.

After H. Pham, Q.-C. Pham, "A new approach to time-optimal path parameterization based on reachability analysis",
IEEE T-RO 2018, specialised to limits that are symmetric about zero. With the path q(s), x = (ds/dt)^2 and
u = d2s/dt2, a joint's acceleration is q' u + q'' x. In an interval of length d, u is constant and x grows by 2 d u.
Limits hold at both ends of the interval with the same u (the paper's interpolation scheme). The derivatives of the path
are taken from inside the interval, so its second derivative may jump between intervals. Each joint and end gives

    |A u + B x| <= a,      x at the interval's beginning.

With the next x' = x + 2 d u, g = 1 - 2 d B / A and p = 2 d a / |A|, this is g x - p <= x' <= g x + p.

Rest (x = 0, u = 0) satisfies all constraints. So the x from which the end can be reached form an interval [0, K] at
every grid point, found backwards from the end by K = min(cap, (K' + p) / g). The greedy forward pass
x' = min(K', g x + p) is then optimal. The cap collects, for all intervals at once, the constraints that do not depend
on the next interval: velocities, every two rows together (which covers zero inertia, A = 0), and x' >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from arm.controller.unit import Limits
from arm.errors import InputError
from arm.se3 import Array, Bools

# Places in an interval where the velocity is checked. Between them the excess, nearly a parabola, can be 1/16 larger;
# the factor adds 1/10.
_BETWEEN = np.array([0.25, 0.5, 0.75])
_ROOM = 1.1
_STEEP = 4.0  # largest x at a grid point relative to that of the middle, where no joint moves


@dataclass(frozen=True, eq=False)
class Gridpoints:
    """Intervals of a path, each inside one polynomial piece.

    Attributes:
        s: (n + 1,) grid points.
        first, second: (n, 5, joints) derivatives at 0, 1/4, 1/2, 3/4 and 1 of each interval, from inside it.
        straight: (n,) whether the path is straight in the interval.
        cap: (n,) largest ds/dt, inf for no cap.
    """

    s: Array
    first: Array
    second: Array
    straight: Bools
    cap: Array


def gridpoints(path: Any, counts: Any, caps: Array) -> Gridpoints:
    """Cut the pieces of a path (scipy PPoly of order at most 3) into equal intervals.

    Args:
        path: with values (joints,).
        counts: (pieces,) int, number of intervals in each piece.
        caps: (pieces,) largest ds/dt, inf for no cap.
    """
    piece = np.repeat(np.arange(len(counts)), counts)
    length = np.diff(path.x)[piece] / counts[piece]
    within = np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)
    begin = within * length
    s = np.append(path.x[:-1][piece] + begin, path.x[-1])
    at = (begin[:, None] + np.array([0.0, 0.25, 0.5, 0.75, 1.0]) * length[:, None])[..., None]
    c = np.zeros((4, *path.c.shape[1:]))
    c[4 - path.c.shape[0] :] = path.c
    cubic, square, slope, _ = c[:, piece][:, :, None]
    return Gridpoints(
        s=s,
        first=slope + at * (2.0 * square + at * 3.0 * cubic),
        second=2.0 * square + at * 6.0 * cubic,
        straight=((c[0] == 0.0) & (c[1] == 0.0)).all(axis=1)[piece],
        cap=np.asarray(caps, dtype=float)[piece],
    )


def parametrise(stage: Gridpoints, limits: Limits, ease: Array | None = None) -> tuple[Array, Array]:
    """Return path parameters s and rates ds/dt, from rest to rest, between which d2s/dt2 is constant.

    Limits are constant in a straight interval; the result has additional points there where a trapezoid switches.

    Args:
        stage: the path.
        limits: limits of velocity and acceleration.
        ease: (n,) divisors of the acceleration limits in each interval, or None.

    Raises:
        InputError: no joint moves.
    """
    step = 2.0 * np.diff(stage.s)
    acceleration = limits.acceleration / (np.ones((1, 1)) if ease is None else ease[:, None])
    acceleration = np.broadcast_to(acceleration, stage.first[:, 0].shape)
    B = np.concatenate([stage.second[:, 0], stage.second[:, -1]], axis=1)
    A = np.concatenate([stage.first[:, 0], stage.first[:, -1] + step[:, None] * stage.second[:, -1]], axis=1)
    a = np.concatenate([acceleration, acceleration], axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        p = np.where(A != 0.0, step[:, None] * a / np.abs(A), np.inf)
        g = np.where(A != 0.0, 1.0 - step[:, None] * B / A, 1.0)
        inside = np.minimum((limits.velocity / np.abs(stage.first)).min(axis=-1), stage.cap[:, None]) ** 2
        speed = speed_caps(inside)
        # x' >= 0 must be reachable
        stop = np.where(g < 0.0, p / -g, np.inf).min(axis=1)
        cap = np.minimum(speed, np.append(np.minimum(_pair_caps(A, B, a, stage.straight), stop), np.inf))
    if not np.isfinite(cap).any():
        raise InputError("the path has no length: no joint moves", count=len(stage.s))
    cap = np.minimum(cap, cap[np.isfinite(cap)].max())
    cap[0] = cap[-1] = 0.0
    x = _passes(p, g, cap)
    return _with_switches(stage, np.asarray(x), p.min(axis=1) / step, inside[:, 2])


def speed_caps(inside: Array) -> Array:
    """Return the largest x at the grid points (n + 1,) that keeps velocity limits there and, x being linear, between.

    `inside` (n, 5) is the largest x under the velocity limits at the five places of every interval.
    """
    ends = np.append(inside[:, 0], np.inf)
    ends[1:] = np.minimum(ends[1:], inside[:, -1])
    # where no joint moves, the velocity has no limit; use that of the interval's middle
    ends[:-1] = np.minimum(ends[:-1], _STEEP * inside[:, 2])
    ends[1:] = np.minimum(ends[1:], _STEEP * inside[:, 2])
    between = ends[:-1, None] + _BETWEEN * np.diff(ends)[:, None]
    excess = np.nan_to_num((between / inside[:, 1:-1]).max(axis=1), nan=1.0, posinf=1.0)
    shrink = np.maximum(1.0, 1.0 + _ROOM * (excess - 1.0))
    ends[:-1] /= shrink
    ends[1:] /= shrink
    return ends


def _pair_caps(A: Array, B: Array, a: Array, straight: Bools) -> Array:
    """Return the largest x (n,) for which some u satisfies every two of the rows |A u + B x| <= a."""
    caps = np.full(len(A), np.inf)
    bent = np.flatnonzero(~straight)
    A, B, a = A[bent], B[bent], a[bent]
    size = np.abs(A)
    i, j = np.triu_indices(A.shape[1], 1)
    both = (a[:, i] * size[:, j] + a[:, j] * size[:, i]) / np.abs(B[:, i] * A[:, j] - B[:, j] * A[:, i])
    alone = np.where(A == 0.0, a / np.abs(B), np.inf)
    caps[bent] = np.minimum(
        np.nan_to_num(both, nan=np.inf).min(axis=1), np.nan_to_num(alone, nan=np.inf).min(axis=1)
    )
    return caps


def _passes(p: Array, g: Array, cap: Array) -> list[float]:
    """Return x at the grid points: the controllable x in a backward pass, then the fastest in a forward pass."""
    reach = cap.tolist()
    rows = [list(zip(*row, strict=True)) for row in zip(p.tolist(), g.tolist(), strict=True)]
    for i in range(len(rows) - 1, -1, -1):
        most, after = reach[i], reach[i + 1]
        for push, gain in rows[i]:
            if gain > 0.0 and after + push < most * gain:
                most = (after + push) / gain
        reach[i] = most
    x = [0.0]
    for i, row in enumerate(rows):
        now, after = x[-1], reach[i + 1]
        for push, gain in row:
            reached = gain * now + push
            if reached < after:
                after = reached
        x.append(after if after > 0.0 else 0.0)
    return x


def _with_switches(stage: Gridpoints, x: Array, push: Array, most: Array) -> tuple[Array, Array]:
    """Return s and rates, with points added where a trapezoid between these rates switches in straight intervals."""
    s, length = stage.s, np.diff(stage.s)
    top = np.minimum((x[:-1] + x[1:]) / 2.0 + push * length, most)
    with np.errstate(invalid="ignore"):
        up, down = (top - x[:-1]) / (2.0 * push), (top - x[1:]) / (2.0 * push)
    # a switch nearer to a grid point than the resolution of s would be the same point
    tiny = np.maximum(1e-9 * length, 4.0 * np.spacing(np.abs(s[1:])))
    rise = stage.straight & (up > tiny) & (down > -tiny) & (up < length - tiny)
    fall = stage.straight & (down > tiny) & (up > -tiny) & (down < length - tiny)
    # a triangle has one switch
    fall &= ~(rise & (length - up - down <= tiny))
    places = np.concatenate([s, (s[:-1] + up)[rise], (s[1:] - down)[fall]])
    squares = np.concatenate([x, top[rise], top[fall]])
    order = np.argsort(places, kind="stable")
    return places[order], np.sqrt(squares[order])
