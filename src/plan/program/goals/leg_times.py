"""Times of legs: out along one line, across, and in along another, from rest to rest, for many pairs at once.

There are two times for each pair of ends. The *estimate* is for ranking: every phase at the full speed of its slowest
joint, plus half of the time of each change of velocity. The *bound* is a lower bound for any motion through both lines,
the larger of

- the sum of three times: either line alone, from rest at its station, and the transit between them, in which every
  joint alone starts and ends with at most the velocity that its line allows there; and
- over the joints, the least time from rest to rest through the joint's values at the ends of the lines, at rest
  wherever it reverses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits
from arm.se3 import Array, Bools, frozen

# Largest ratio of the velocity at the very end of a line to that over its last 5 mm; a generous upper limit.
_FASTER = 1.1


@dataclass(frozen=True, eq=False)
class LineEnds:
    """Ends of k legs: a line from a station out to its offset point, or a configuration at rest (no line).

    Attributes:
        station, offset: (k, n) rad; equal if there is no line.
        time: (k,) s, time of the line at full speed.
        velocity: (k, n) rad/s at the offset point, outwards.
        start: (k,) s, time lost by the acceleration at the station.
        least: (k,) s, lower bound on the time along the line, from rest at the station.
        fastest: (k, n) rad/s, upper bound on the velocity along the line at the offset point.
        rests: (k,) whether the arm is at rest at the station.
    """

    station: Array
    offset: Array
    time: Array
    velocity: Array
    start: Array
    least: Array
    fastest: Array
    rests: Bools

    def row(self, index: int) -> LineEnds:
        """Return one of them."""
        one = slice(index, index + 1)
        return LineEnds(*(getattr(self, field.name)[one] for field in fields(self)))


def standing(q: npt.ArrayLike) -> LineEnds:
    """Return a configuration (n,) rad at rest, as the end of a leg."""
    at = np.atleast_2d(np.asarray(q, dtype=float))
    none, still = frozen(np.zeros(len(at))), frozen(np.zeros_like(at))
    return LineEnds(frozen(at), frozen(at), none, still, none, none, still, np.ones(len(at), dtype=bool))


def passing(station: Array, offset: Array, velocity: Array, least: float, rests: bool) -> LineEnds:
    """Return one end of a leg whose line's time counts elsewhere in estimates.

    Args:
        station, offset: (n,) rad.
        velocity: (n,) rad/s at the offset point, outwards.
        least: lower bound on the time between station and offset point, s.
        rests: whether the arm is at rest at the station.
    """
    none, outwards = frozen(np.zeros(1)), frozen(velocity[None])
    ends = frozen(station[None]), frozen(offset[None])
    return LineEnds(
        *ends, none, outwards, none, frozen([least]), frozen(_FASTER * outwards), np.array([rests])
    )


def stacked(ends: Sequence[LineEnds]) -> LineEnds:
    """Return ends of legs as one."""
    return LineEnds(*(np.concatenate([getattr(e, field.name) for e in ends]) for field in fields(LineEnds)))


def line_ends(q: npt.ArrayLike, length: float, limits: Limits, tool_speed: float | None) -> LineEnds:
    """Return lines as ends of legs, from samples q (k, m, n) rad from the station outwards, `length` m long.

    Args:
        tool_speed: largest speed of the tool, m/s, or None.
    """
    q = np.asarray(q, dtype=float)
    steps = np.diff(q, axis=1)
    # each stretch at the full speed of its slowest joint: a lower bound, and close to the actual time
    times = (np.abs(steps) / limits.velocity).max(axis=-1)
    least = 0.0 if tool_speed is None else length / (q.shape[1] - 1) / tool_speed
    times = np.maximum(times, least)
    first, last = steps[:, 0] / times[:, :1], steps[:, -1] / times[:, -1:]
    return LineEnds(
        frozen(q[:, 0]),
        frozen(q[:, -1]),
        frozen(times.sum(axis=1)),
        frozen(last),
        frozen(0.5 * (np.abs(first) / limits.acceleration).max(axis=-1)),
        frozen(least_from_rest(steps, np.full(steps.shape[1], least), limits)),
        frozen(_FASTER * last),
        np.ones(len(q), dtype=bool),
    )


def leg_times(out: LineEnds, into: LineEnds, limits: Limits) -> Array:
    """Return estimates (k, l) s of the legs from each of `out` to each of `into`, with straight joint motions."""
    across = into.offset[None] - out.offset[:, None]
    time = (np.abs(across) / limits.velocity).max(axis=-1)
    velocity = across / np.maximum(time, 1e-9)[..., None]
    turns = (np.abs(velocity - out.velocity[:, None]) / limits.acceleration).max(axis=-1)
    turns += (np.abs(velocity + into.velocity[None]) / limits.acceleration).max(axis=-1)
    ends = (out.time + out.start)[:, None] + (into.time + into.start)[None]
    return np.asarray(ends + time + 0.5 * turns)


def leg_bounds(out: LineEnds, into: LineEnds, limits: Limits) -> Array:
    """Return lower bounds (k, l) s of the same legs, whatever the path between the lines."""
    across = into.offset[None] - out.offset[:, None]
    shape = across.shape
    # a line's velocity counts if it points towards the joint's goal; otherwise rest is best
    enter = np.maximum(np.sign(across) * out.fastest[:, None], 0.0)
    leave = np.maximum(-np.sign(across) * into.fastest[None], 0.0)
    between = _moving(np.abs(across), enter, leave, limits).max(axis=-1)
    phases = out.least[:, None] + between + into.least[None]
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
    resting = out.rests[:, None] & into.rests[None]
    return np.asarray(np.where(resting, np.maximum(phases, joints.max(axis=-1)), phases))


def least_from_rest(steps: Array, least: Array, limits: Limits) -> Array:
    """Return least times (k,) s from rest over `steps` (k, m, n) rad, which take at least `least` (m,) s each.

    A joint that starts at rest has a velocity of at most a t after time t. Each step waits for its slowest joint.
    """
    v, a = limits.velocity, limits.acceleration
    ramp = v * v / (2.0 * a)
    time = np.zeros(len(steps))
    for step, allowed in zip(np.moveaxis(np.abs(steps), 1, 0), least.tolist(), strict=True):
        now = time[:, None]
        reach = np.where(now < v / a, 0.5 * a * now * now, v * now - ramp) + step
        arrived = np.where(reach < ramp, np.sqrt(2.0 * reach / a), reach / v + v / (2.0 * a))
        # a joint that does not move needs no time
        arrived = np.where(step > 0.0, arrived, now).max(axis=-1)
        time = np.maximum(arrived, time + allowed)
    return time


def _moving(way: Array, enter: Array, leave: Array, limits: Limits) -> Array:
    """Return least times (..., n) s of each joint alone over `way` >= 0 rad, with at most these velocities at the ends.

    At time t of T the velocity is at most enter + a t, leave + a (T - t) and v. `way` is at most the integral of the
    least of the three, which is solved for T.
    """
    v, a = limits.velocity, limits.acceleration
    enter, leave = np.minimum(enter, v), np.minimum(leave, v)
    slower = np.minimum(enter, leave)
    top = np.sqrt(a * way + 0.5 * (enter * enter + leave * leave))
    return np.asarray(
        np.where(
            top > v,
            way / v + ((v - enter) ** 2 + (v - leave) ** 2) / (2.0 * a * v),
            np.where(
                top >= np.maximum(enter, leave),
                (2.0 * top - enter - leave) / a,
                (np.sqrt(slower * slower + 2.0 * a * way) - slower) / a,
            ),
        )
    )


def _rest_to_rest(step: Array, limits: Limits) -> Array:
    """Return the least time (..., n) s of each joint alone over `step` (..., n) rad, from rest to rest."""
    way = np.abs(step)
    v, a = limits.velocity, limits.acceleration
    return np.asarray(np.where(way * a >= v * v, way / v + v / a, 2.0 * np.sqrt(way / a)))
