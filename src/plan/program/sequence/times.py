"""Times of chains and of the transits between them: estimates for ranking, and lower bounds on any motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits
from arm.se3 import Array, frozen
from plan.program.goals.blending import blend_distance
from plan.program.goals.line_chains import LinearMove, LineChain, TargetReached
from plan.program.goals.target import Target
from plan.trajectory.time_estimates import path_times

_MIDDLE = 33  # samples of a line with blended ends


@dataclass(frozen=True, eq=False)
class ChainTime:
    """Times of one chain.

    Attributes:
        enter, leave: velocities (n,) rad/s at its ends; 0 if it begins or ends at rest.
        inner: estimate of the time from end to end, s.
        head, tail: configurations (m, n) rad that every motion passes, up to the first stop and from the last stop on;
            None if there is no stop, or a corner is blended there.
        head_s, tail_s: lower bounds on the times of head and tail, s; without a stop `head_s` is for the whole chain.
        between_s: lower bound on the time from the first to the last stop, dwells included, s.
    """

    enter: Array
    leave: Array
    inner: float
    head: Array | None
    tail: Array | None
    head_s: float
    tail_s: float
    between_s: float


@dataclass(frozen=True, eq=False)
class _Run:
    """Lines between stops."""

    points: Array
    least: float
    exact: bool


def chain_time(chain: LineChain, targets: Sequence[Target], limits: Limits) -> ChainTime:
    """Return estimates and bounds of one chain."""
    still = np.zeros(len(limits.velocity))
    runs = [_Run(chain.q_in[None], 0.0, True)]
    inner = dwell = 0.0
    velocity: Array | None = None
    items = chain.items
    for number, item in enumerate(items):
        if isinstance(item, TargetReached):
            target = targets[item.target]
            # at a target between two transits the arm stops too, unless its corner may be blended
            alone = len(items) == 1 and target.blend_radius == 0.0
            if target.stops or alone:
                inner += target.dwell_s + (0.0 if velocity is None else _half(velocity, limits))
                dwell += target.dwell_s
                runs.append(_Run(runs[-1].points[-1:], 0.0, True))
                velocity = still
            continue
        start, end = _velocities(item, limits)
        before, after = _neighbour(items, number, -1), _neighbour(items, number, +1)
        if velocity is not None:
            corner = before is not None and blend_distance(before, item, targets) > 0.0
            inner += (
                _half(start - velocity, limits) if corner else _half(velocity, limits) + _half(start, limits)
            )
            if before is not None and not corner and np.abs(velocity).max() > 0.0:
                runs.append(_Run(runs[-1].points[-1:], 0.0, True))
        cuts = (
            0.0 if before is None else blend_distance(before, item, targets),
            0.0 if after is None else blend_distance(item, after, targets),
        )
        least = _line_least(item, cuts, limits)
        inner += least
        last = runs[-1]
        runs[-1] = _Run(
            np.concatenate([last.points, item.path.q[1:]]),
            last.least + least,
            last.exact and max(cuts) == 0.0,
        )
        velocity = end
    lines = chain.lines
    first = items[0]
    at_rest = not lines or (isinstance(first, TargetReached) and targets[first.target].stops)
    enter = still if at_rest else _velocities(lines[0], limits)[0]
    leave = velocity if lines and velocity is not None else still
    only = len(runs) == 1
    return ChainTime(
        frozen(enter),
        frozen(leave),
        inner,
        runs[0].points if runs[0].exact and not only else None,
        runs[-1].points if runs[-1].exact and not only else None,
        runs[0].least,
        0.0 if only else runs[-1].least,
        dwell + sum(max(run.least, _through(run, limits)) for run in runs[1:-1]),
    )


def standing_time(q: Array) -> ChainTime:
    """Return the times of the start: a configuration (n,) rad at rest, without lines."""
    still = frozen(np.zeros(len(q)))
    return ChainTime(still, still, 0.0, frozen(q[None]), frozen(q[None]), 0.0, 0.0, 0.0)


def way_estimates(
    q_out: Array, q_in: Array, out: Sequence[ChainTime], into: Sequence[ChainTime], limits: Limits
) -> Array:
    """Return estimates (k, l) s of straight joint motions from q_out (k, n) to q_in (l, n)."""
    shape = (len(q_out), len(q_in), q_out.shape[1])
    ways = np.stack([np.broadcast_to(q_out[:, None], shape), np.broadcast_to(q_in[None], shape)], axis=2)
    leave = np.stack([t.leave for t in out])[:, None]
    enter = np.stack([t.enter for t in into])[None]
    return path_times(ways, limits, leave, enter)


def way_bounds(
    q_out: Array, q_in: Array, out: Sequence[ChainTime], into: Sequence[ChainTime], limits: Limits
) -> Array:
    """Return lower bounds (k, l) s from the last stop of one chain to the first stop of the next, whatever the path."""
    across = (np.abs(q_in[None] - q_out[:, None]) / limits.velocity).max(axis=-1)
    bound = across + np.array([t.tail_s for t in out])[:, None] + np.array([t.head_s for t in into])
    points = [[t.tail for t in out], [t.head for t in into]]
    if all(
        p is not None and len(p) == 1 for ends in points for p in ends
    ):  # from stop to stop, without lines
        tails, heads = (np.concatenate([p for p in ends if p is not None]) for ends in points)
        return np.asarray(np.maximum(bound, _apart(heads[None] - tails[:, None], limits)))
    for i, a in enumerate(out):
        for j, b in enumerate(into):
            if a.tail is not None and b.head is not None:
                bound[i, j] = max(bound[i, j], rest_to_rest(np.concatenate([a.tail, b.head]), limits))
    return np.asarray(bound)


def _apart(steps: Array, limits: Limits) -> Array:
    """Return the least times (...) from rest to rest over steps (..., n) rad, each joint at its own limits."""
    way, v, a = np.abs(steps), limits.velocity, limits.acceleration
    way = np.where(way > 1e-9, way, 0.0)
    times = np.where(way * a >= v * v, way / v + v / a, 2.0 * np.sqrt(way / a))
    return np.asarray(times.max(axis=-1))


def rest_to_rest(points: Array, limits: Limits) -> float:
    """Return the least time from rest to rest through configurations (m, n); a joint rests wherever it reverses."""
    worst = 0.0
    for values, v, a in zip(points.T, limits.velocity, limits.acceleration, strict=True):
        steps = np.diff(values)
        steps = steps[np.abs(steps) > 1e-9]
        if not len(steps):
            continue
        back = np.concatenate([[0], np.cumsum(np.diff(np.sign(steps)) != 0)])
        way = np.bincount(back, weights=np.abs(steps))
        worst = max(worst, float(np.where(way * a >= v * v, way / v + v / a, 2.0 * np.sqrt(way / a)).sum()))
    return worst


def _neighbour(items: Sequence[LinearMove | TargetReached], number: int, step: int) -> LinearMove | None:
    """Return the next line in a direction (+1 or -1); None if there is none."""
    other = number + step
    if 0 <= other < len(items) and isinstance(items[other], TargetReached):
        other += step
    found = items[other] if 0 <= other < len(items) else None
    return found if isinstance(found, LinearMove) else None


def _velocities(item: LinearMove, limits: Limits) -> tuple[Array, Array]:
    """Return the velocities at both ends of a line, at the full speed of its slowest joint or of the tool."""
    steps, along = np.diff(item.path.q, axis=0), np.diff(item.path.s)
    times = np.maximum((np.abs(steps) / limits.velocity).max(axis=1), along / item.speed)
    return steps[0] / times[0], steps[-1] / times[-1]


def _line_least(item: LinearMove, cuts: tuple[float, float], limits: Limits) -> float:
    """Return the least time of a line between its blends, s."""
    s, q = item.path.s, item.path.q
    if max(cuts) > 0.0:
        s = np.linspace(cuts[0], s[-1] - cuts[1], _MIDDLE)
        q = CubicSpline(item.path.s, q)(s)
    return float(
        np.maximum((np.abs(np.diff(q, axis=0)) / limits.velocity).max(axis=1), np.diff(s) / item.speed).sum()
    )


def _half(change: Array, limits: Limits) -> float:
    return 0.5 * float((np.abs(change) / limits.acceleration).max())


def _through(run: _Run, limits: Limits) -> float:
    return rest_to_rest(run.points, limits) if run.exact else 0.0
