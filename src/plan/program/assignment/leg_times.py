"""How long a leg takes: out along one line, across, and in along another, from rest to rest, many pairs at once.

Two figures for each pair of ends. The *estimate* ranks: every phase at the full speed of its slowest joint, plus half
of what each change of velocity takes. The *bound* is proved: no motion through these forced places is faster. It is
the larger of

- the sum over the phases of the time that the slowest joint needs at full speed (and the tool at its own), and
- over the joints, the least time from rest to rest through the joint's forced values, at rest wherever it turns back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits
from arm.se3 import Array, frozen


@dataclass(frozen=True, eq=False)
class LineEnds:
    """Ends of legs, k of them: a line from a station out to its offset point, or a place to stand (no line).

    Attributes:
        station, offset: (k, n) rad; the same where there is no line.
        time: (k,) s of the line at full speed.
        velocity: (k, n) rad/s with which the line outwards passes the offset point.
        start: (k,) s that it costs to get going at the station.
    """

    station: Array
    offset: Array
    time: Array
    velocity: Array
    start: Array

    def row(self, index: int) -> LineEnds:
        """One of them."""
        one = slice(index, index + 1)
        return LineEnds(*(a[one] for a in (self.station, self.offset, self.time, self.velocity, self.start)))


def standing(q: npt.ArrayLike) -> LineEnds:
    """A place to stand, (n,) rad, as the end of a leg."""
    at = np.atleast_2d(np.asarray(q, dtype=float))
    none = frozen(np.zeros(len(at)))
    return LineEnds(frozen(at), frozen(at), none, frozen(np.zeros_like(at)), none)


def line_ends(q: npt.ArrayLike, length: float, limits: Limits, tool_speed: float | None) -> LineEnds:
    """Lines as samples q (k, m, n) rad from the station outwards, `length` m long.

    Args:
        tool_speed: cap on the tool's speed, m/s, or None.
    """
    q = np.asarray(q, dtype=float)
    steps = np.diff(q, axis=1)
    # each stretch at the full speed of its slowest joint: a bound, and near what is reached
    times = (np.abs(steps) / limits.velocity).max(axis=-1)
    if tool_speed is not None:
        times = np.maximum(times, length / (q.shape[1] - 1) / tool_speed)
    first, last = steps[:, 0] / times[:, :1], steps[:, -1] / times[:, -1:]
    return LineEnds(
        frozen(q[:, 0]),
        frozen(q[:, -1]),
        frozen(times.sum(axis=1)),
        frozen(last),
        frozen(0.5 * (np.abs(first) / limits.acceleration).max(axis=-1)),
    )


def leg_times(out: LineEnds, into: LineEnds, limits: Limits) -> Array:
    """Estimates (k, l) s of the legs from each of `out` to each of `into`, straight in joint space between them."""
    across = into.offset[None] - out.offset[:, None]
    time = (np.abs(across) / limits.velocity).max(axis=-1)
    velocity = across / np.maximum(time, 1e-9)[..., None]
    turns = (np.abs(velocity - out.velocity[:, None]) / limits.acceleration).max(axis=-1)
    turns += (np.abs(velocity + into.velocity[None]) / limits.acceleration).max(axis=-1)
    ends = (out.time + out.start)[:, None] + (into.time + into.start)[None]
    return np.asarray(ends + time + 0.5 * turns)


def leg_bounds(out: LineEnds, into: LineEnds, limits: Limits) -> Array:
    """Lower bounds (k, l) s of the same legs, whatever the way across."""
    across = into.offset[None] - out.offset[:, None]
    shape = across.shape
    phases = out.time[:, None] + (np.abs(across) / limits.velocity).max(axis=-1) + into.time[None]
    one = np.broadcast_to((out.offset - out.station)[:, None], shape)
    three = np.broadcast_to((into.station - into.offset)[None], shape)
    first_runs_on, last_runs_on = one * across >= 0.0, across * three >= 0.0
    rest = _rest_to_rest
    joints = np.where(
        first_runs_on & last_runs_on,
        rest(one + across + three, limits),
        np.where(
            first_runs_on,
            rest(one + across, limits) + rest(three, limits),
            np.where(
                last_runs_on,
                rest(one, limits) + rest(across + three, limits),
                rest(one, limits) + rest(across, limits) + rest(three, limits),
            ),
        ),
    )
    return np.asarray(np.maximum(phases, joints.max(axis=-1)))


def _rest_to_rest(step: Array, limits: Limits) -> Array:
    """Least time (..., n) s of each joint alone to move by `step` (..., n) rad from rest to rest."""
    way = np.abs(step)
    v, a = limits.velocity, limits.acceleration
    return np.asarray(np.where(way * a >= v * v, way / v + v / a, 2.0 * np.sqrt(way / a)))
