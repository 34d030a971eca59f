"""Times of chains and of the transits between them: estimates for ranking, and lower bounds on any motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits
from arm.se3 import Array
from plan.program.goals.blending import blend_distance
from plan.program.goals.leg_times import LineEnds, least_from_rest, passing, standing
from plan.program.goals.line_chains import LineChain, TargetReached
from plan.program.goals.linear_move import LinearMove
from plan.program.goals.target import Target

_MIDDLE = 33  # samples of a line with blended ends


@dataclass(frozen=True, eq=False)
class ChainTime:
    """Times of one chain.

    Attributes:
        arrive, depart: its ends, from the first stop outwards and from the last stop outwards (one row each).
        inner: estimate of the time from end to end, s.
        between_s: lower bound on the time from the first to the last stop, dwells included, s.
        passed: whether it is a single target between two transits that is passed near it, at speed.
    """

    arrive: LineEnds
    depart: LineEnds
    inner: float
    between_s: float
    passed: bool = False


@dataclass(frozen=True, eq=False)
class _Run:
    """Lines between stops.

    Attributes:
        points: configurations (m, n) rad along it.
        fastest: times (m - 1,) s from one to the next at the largest speed of the tool.
        least: lower bound on its time, s.
        exact: whether every motion passes all points; not if a corner is blended.
    """

    points: Array
    fastest: Array
    least: float
    exact: bool

    def from_rest(self, limits: Limits) -> float:
        """Return a lower bound on its time if the arm is at rest at its first point, s."""
        if not self.exact or len(self.points) == 1:
            return self.least
        steps = np.diff(self.points, axis=0)
        return max(self.least, float(least_from_rest(steps[None], self.fastest, limits)[0]))

    def reversed(self) -> _Run:
        """Return it from its end to its begin."""
        return replace(self, points=self.points[::-1], fastest=self.fastest[::-1])


def _stop(q: Array) -> _Run:
    """Return a run that ends where it begins, at q (n,) rad."""
    return _Run(q[None], np.zeros(0), 0.0, True)


def chain_time(chain: LineChain, targets: Sequence[Target], limits: Limits) -> ChainTime:
    """Return estimates and bounds of one chain."""
    still = np.zeros(len(limits.velocity))
    runs = [_stop(chain.q_in)]
    inner = dwell = 0.0
    passed = False
    velocity: Array | None = None
    items = chain.items
    for number, item in enumerate(items):
        if isinstance(item, TargetReached):
            target = targets[item.target]
            # at a target between two transits the arm stops too, unless its corner may be blended
            passed = len(items) == 1 and target.blend_radius > 0.0 and not target.stops
            if target.stops or (len(items) == 1 and not passed):
                inner += target.dwell_s + (0.0 if velocity is None else _half(velocity, limits))
                dwell += target.dwell_s
                runs.append(_stop(runs[-1].points[-1]))
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
                runs.append(_stop(runs[-1].points[-1]))
        cuts = (
            0.0 if before is None else blend_distance(before, item, targets),
            0.0 if after is None else blend_distance(item, after, targets),
        )
        least = _line_least(item, cuts, limits)
        inner += least
        last = runs[-1]
        runs[-1] = _Run(
            np.concatenate([last.points, item.path.q[1:]]),
            np.concatenate([last.fastest, np.diff(item.path.s) / item.speed]),
            last.least + least,
            last.exact and max(cuts) == 0.0,
        )
        velocity = end
    lines = chain.lines
    first = items[0]
    at_rest = not lines or (isinstance(first, TargetReached) and targets[first.target].stops)
    enter = still if at_rest else _velocities(lines[0], limits)[0]
    leave = velocity if lines and velocity is not None else still
    stops, first_run, last_run = len(runs) > 1, runs[0], runs[-1]
    head_s = first_run.reversed().from_rest(limits) if stops else first_run.least
    tail_s = last_run.from_rest(limits) if stops else 0.0
    return ChainTime(
        passing(first_run.points[-1], chain.q_in, -enter, head_s, stops),
        passing(last_run.points[0], chain.q_out, leave, tail_s, stops),
        inner,
        dwell + sum(max(run.from_rest(limits), _through(run, limits)) for run in runs[1:-1]),
        passed,
    )


def standing_time(q: Array) -> ChainTime:
    """Return the times of the start: a configuration (n,) rad at rest, without lines."""
    return ChainTime(standing(q), standing(q), 0.0, 0.0)


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
