"""Time-optimal rates along a path under symmetric velocity and acceleration limits, by reachability analysis.

After H. Pham, Q.-C. Pham, "A new approach to time-optimal path parameterization based on reachability analysis",
IEEE T-RO 2018, specialised to boxes that are symmetric about zero. With the path q(s), x = (ds/dt)^2 and u = d2s/dt2,
a joint's acceleration is q' u + q'' x. In an interval of length d, u is constant and x grows by 2 d u. Limits are
asked for at both ends of the interval with the same u (the paper's interpolation scheme), with the derivatives that
the path has inside the interval, so that its second derivative may jump between intervals. Every joint and end gives

    |A u + B x| <= a,      x at the interval's beginning,

which, with the next x' = x + 2 d u, g = 1 - 2 d B / A and p = 2 d a / |A|, reads g x - p <= x' <= g x + p.

Rest (x = 0, u = 0) keeps all of these, so the rates from which the end can be reached are [0, K] at every place:
one number, found from the end backwards by K = min(cap, (K' + p) / g). Greedy from the beginning, x' = min(K',
g x + p), is then optimal. What does not depend on the next interval is in the cap, for all intervals at once: speeds,
every two rows together (which covers zero inertia, A = 0), and x' >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits
from arm.errors import InputError
from arm.se3 import Array

Flags = npt.NDArray[np.bool_]

# Of an interval, where speed between its ends is compared with what both ends allow. Between these the excess, a
# parabola nearly, can be a sixteenth larger; a tenth is added.
_BETWEEN = np.array([0.25, 0.5, 0.75])
_ROOM = 1.1
_STEEP = 4.0


@dataclass(frozen=True, eq=False)
class Stages:
    """Intervals of a path, each inside one polynomial piece.

    Attributes:
        s: (n + 1,) where they begin and end.
        first, second: (n, 5, joints) derivatives at 0, 1/4, 1/2, 3/4 and 1 of each interval, from inside it.
        straight: (n,) whether the path is straight there.
        cap: (n,) largest ds/dt allowed, inf where there is none.
    """

    s: Array
    first: Array
    second: Array
    straight: Flags
    cap: Array


def stages(path: Any, counts: Any, caps: Array) -> Stages:
    """Cut the pieces of a path (scipy PPoly of order at most 3) into equal intervals.

    Args:
        path: values (joints,).
        counts: (pieces,) int, intervals in each.
        caps: (pieces,) largest ds/dt, inf where there is none.
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
    return Stages(
        s=s,
        first=slope + at * (2.0 * square + at * 3.0 * cubic),
        second=2.0 * square + at * 6.0 * cubic,
        straight=((c[0] == 0.0) & (c[1] == 0.0)).all(axis=1)[piece],
        cap=np.asarray(caps, dtype=float)[piece],
    )


def fastest(stage: Stages, limits: Limits, ease: Array | None = None) -> tuple[Array, Array]:
    """Places s and rates ds/dt, from rest to rest, between which d2s/dt2 is constant.

    In a straight interval the limits are the same everywhere; there, places are added where a trapezoid switches.

    Args:
        stage: the path.
        limits: of velocity and acceleration.
        ease: (n,) by which acceleration limits are divided in each interval, or None.

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
        speed = _speed_caps(inside)
        # x' >= 0 must be within reach
        stop = np.where(g < 0.0, p / -g, np.inf).min(axis=1)
        cap = np.minimum(speed, np.append(np.minimum(_pair_caps(A, B, a, stage.straight), stop), np.inf))
    if not np.isfinite(cap).any():
        raise InputError("the path has no length: no joint moves", count=len(stage.s))
    cap = np.minimum(cap, cap[np.isfinite(cap)].max())
    cap[0] = cap[-1] = 0.0
    x = _passes(p, g, cap)
    return _with_switches(stage, np.asarray(x), p.min(axis=1) / step, inside[:, 2])


def _speed_caps(inside: Array) -> Array:
    """Largest x at every place (n + 1,) with which speeds are kept there and, x being linear, between them too.

    `inside` (n, 5) holds what speeds allow x to be at the five places of every interval.
    """
    ends = np.append(inside[:, 0], np.inf)
    ends[1:] = np.minimum(ends[1:], inside[:, -1])
    # in a place where no joint moves speed has no limit: there it is bound by that nearby
    ends[:-1] = np.minimum(ends[:-1], _STEEP * inside[:, 2])
    ends[1:] = np.minimum(ends[1:], _STEEP * inside[:, 2])
    between = ends[:-1, None] + _BETWEEN * np.diff(ends)[:, None]
    excess = np.nan_to_num((between / inside[:, 1:-1]).max(axis=1), nan=1.0, posinf=1.0)
    shrink = np.maximum(1.0, 1.0 + _ROOM * (excess - 1.0))
    ends[:-1] /= shrink
    ends[1:] /= shrink
    return ends


def _pair_caps(A: Array, B: Array, a: Array, straight: Flags) -> Array:
    """Largest x (n,) for which some u keeps each two of the rows |A u + B x| <= a."""
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
    """x at every place: backwards what can still stop, then forwards as fast as that allows."""
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


def _with_switches(stage: Stages, x: Array, push: Array, most: Array) -> tuple[Array, Array]:
    """Rates, with the places added at which a trapezoid with these end rates switches in the straight intervals."""
    s, length = stage.s, np.diff(stage.s)
    top = np.minimum((x[:-1] + x[1:]) / 2.0 + push * length, most)
    with np.errstate(invalid="ignore"):
        up, down = (top - x[:-1]) / (2.0 * push), (top - x[1:]) / (2.0 * push)
    tiny = 1e-9 * length
    rise = stage.straight & (up > tiny) & (down > -tiny) & (up < length - tiny)
    fall = stage.straight & (down > tiny) & (up > -tiny) & (down < length - tiny)
    # a triangle has one switch
    fall &= ~(rise & (length - up - down <= tiny))
    places = np.concatenate([s, (s[:-1] + up)[rise], (s[1:] - down)[fall]])
    squares = np.concatenate([x, top[rise], top[fall]])
    order = np.argsort(places, kind="stable")
    return places[order], np.sqrt(squares[order])
