"""Inverse kinematics with a free rotation about one tool axis: the intervals of feasible angles for every branch.

The search samples each branch every degree of the circle, and more finely where joints move fast or come near a limit.
It then narrows each end of an interval to about 1e-8 rad. Between two samples it finds an interval or a gap only if the
slopes of the joints indicate one. It may miss a joint that crosses its limit between samples through curvature alone,
by less than 0.1 mrad.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.numerics.products import mul
from arm.robot.model import Robot
from arm.se3 import Array, Bools, Indices, frozen, skew
from plan.kinematics.closed_form import BRANCH_NAMES, RawBranches, all_branches
from plan.kinematics.ik import nearest_turns
from plan.kinematics.straight_line import AXES

_SAMPLES = 360
_JUMP = 0.3  # rad: a larger step of a joint between samples counts as a discontinuity
_REFINEMENTS = 3
_PARTS = 12  # parts that a gap between samples is divided into
_NARROWINGS = 6
_SLACK = 1e-12  # rad, on limits


@dataclass(frozen=True)
class FreeInterval:
    """Angles over which one branch, in one choice of revolutions, is continuous and within limits.

    Attributes:
        branch: see `plan.kinematics.ik.BRANCH_NAMES`.
        angles: (s,) increasing, rad; the first in [-pi, pi), the last at most 2 pi later. The pose at an angle is
            T_base_tool rotated by it about the free axis.
        q: (s, 6) rad, at these angles.
        stops: what ends the interval at its start and at its end, such as "J4 upper limit"; "reach" at the end of the
            links' reach; "singular" where a joint jumps; "" for a full circle.
        singular: angles of singular configurations; these are ends, because two branches meet there.
        least_sine: the smallest `RawBranches.sine` over the samples; 0 if singular throughout.
    """

    branch: str
    angles: Array
    q: Array
    stops: tuple[str, str]
    singular: tuple[float, ...]
    least_sine: float

    @property
    def start(self) -> float:
        """First angle, rad."""
        return float(self.angles[0])

    @property
    def end(self) -> float:
        """Last angle, rad."""
        return float(self.angles[-1])

    @property
    def length(self) -> float:
        """Length, rad."""
        return self.end - self.start


def turned_poses(T_base_tool: npt.ArrayLike, axis: str, angles: npt.ArrayLike) -> Array:
    """Rotate a pose (4, 4) about its own `axis` by angles (k,) rad; return (k, 4, 4).

    Raises:
        InputError: `axis` is not one of `AXES`.
    """
    if axis not in AXES:
        raise InputError(f"axis = {axis!r}: must be one of {', '.join(AXES)}", axis=axis)
    T, angle = np.asarray(T_base_tool, dtype=float), np.asarray(angles, dtype=float)[:, None, None]
    K = skew(np.eye(3)[AXES.index(axis)])
    turned = np.tile(T, (len(angle), 1, 1))
    turned[:, :3, :3] = mul(
        T[:3, :3], np.eye(3) + np.sin(angle) * K + 2 * np.sin(angle / 2) ** 2 * (mul(K, K))
    )
    return turned


def feasible_intervals(
    robot: Robot, T_base_tool: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike, axis: str = "z"
) -> tuple[FreeInterval, ...]:
    """Return every interval of the free angle about `axis`, ordered by branch, start, revolutions.

    Args:
        robot: an arm with closed-form inverse kinematics.
        T_base_tool: (4, 4), the pose at angle 0.
        lower, upper: (6,) rad.
        axis: free axis of the tool, one of `AXES`.

    Raises:
        InputError: the arm has another geometry, or the axis is not known.
    """
    circle = _Circle(
        robot,
        np.asarray(T_base_tool, dtype=float),
        axis,
        np.asarray(lower, dtype=float),
        np.asarray(upper, dtype=float),
    )
    found = circle.run([s for branch in range(len(BRANCH_NAMES)) for s in circle.intervals(branch)])
    return tuple(i for name in BRANCH_NAMES for i in _joined([i for i in found if i.branch == name]))


def sample_free(
    robot: Robot, T_base_tool: npt.ArrayLike, intervals: Sequence[FreeInterval], count: int, axis: str = "z"
) -> tuple[Array, Indices, Bools]:
    """Sample about `count` poses from `feasible_intervals` in proportion to their lengths.

    Each interval has at least one sample, and no sample is at an end.

    Returns:
        Configurations (k, 6) rad, the index (k,) of the interval of each, and whether it is singular (k,).

    Raises:
        InputError: as `feasible_intervals`.
    """
    total = sum(i.length for i in intervals)
    angles, guess, which = [np.zeros(0)], [np.zeros((0, robot.model.nq))], [np.zeros(0, dtype=np.intp)]
    for index, interval in enumerate(intervals):
        # rounded twice, so that the number does not depend on the last bits
        share = max(1, round(round(count * interval.length / total, 6))) if total > 0.0 else 1
        at = interval.start + interval.length * (np.arange(share) + 0.5) / share
        angles.append(at)
        guess.append(np.stack([np.interp(at, interval.angles, q) for q in interval.q.T], axis=1))
        which.append(np.full(share, index))
    angle, near, interval_of = np.concatenate(angles), np.concatenate(guess), np.concatenate(which)
    raw = all_branches(robot, turned_poses(T_base_tool, axis, angle))
    branch = np.array([BRANCH_NAMES.index(intervals[i].branch) for i in interval_of], dtype=np.intp)
    rows = np.arange(len(angle))
    q = nearest_turns(raw.q[rows, branch], near)
    return frozen(q), interval_of, raw.singular[rows, branch]


Result = TypeVar("Result")
_Search = Generator[Array, RawBranches, Result]
"""A generator that yields angles, receives the branches there, and returns its result."""


class _Circle:
    """Samples of all branches over the full circle of the free angle, fine enough to follow them."""

    def __init__(self, robot: Robot, T: Array, axis: str, lower: Array, upper: Array) -> None:
        self.robot, self.T, self.axis, self.lower, self.upper = robot, T, axis, lower, upper
        self.angles = np.linspace(-np.pi, np.pi, _SAMPLES + 1)
        self.raw = self.solved(self.angles)
        for _ in range(_REFINEMENTS):
            gaps = np.unique(np.concatenate([self.unclear(b) for b in range(len(BRANCH_NAMES))]))
            if not len(gaps):
                break
            step = np.diff(self.angles)[gaps, None]
            self.add((self.angles[gaps, None] + step * np.arange(1, _PARTS) / _PARTS).ravel())

    def solved(self, angles: Array) -> RawBranches:
        return all_branches(self.robot, turned_poses(self.T, self.axis, angles))

    def add(self, angles: Array) -> None:
        merged = np.concatenate([self.angles, angles])
        order = np.argsort(merged, kind="stable")
        self.angles = merged[order]
        self.raw = RawBranches.joined([self.raw, self.solved(angles)]).rows(order)

    def curves(self, branch: int) -> Iterator[tuple[slice, Array]]:
        """Yield runs of samples in which a branch is reached and continuous, with q (s, 6) in every revolution."""
        reached, q = self.raw.reached[:, branch], self.raw.q[:, branch]
        jumps = np.abs(nearest_turns(np.diff(q, axis=0), np.zeros(q.shape[1]))).max(axis=1) > _JUMP
        linked = reached[1:] & reached[:-1] & ~jumps
        for start, stop in _runs(reached, linked):
            curve = np.unwrap(q[start:stop], axis=0)
            first = np.ceil((self.lower - _SLACK - curve.max(axis=0)) / (2 * np.pi))
            last = np.floor((self.upper + _SLACK - curve.min(axis=0)) / (2 * np.pi))
            for turns in product(*(np.arange(a, b + 1) for a, b in zip(first, last, strict=True))):
                yield slice(start, stop), curve + 2 * np.pi * np.array(turns)

    def margin(self, q: Array) -> Array:
        """Return the distance (s,) to the nearest limit, rad; negative beyond."""
        return np.asarray(np.minimum(q - self.lower, self.upper - q).min(axis=-1)) + _SLACK

    def unclear(self, branch: int) -> Indices:
        """Return gaps between samples in which a joint moves far, or may cross a limit and come back."""
        reached, q = self.raw.reached[:, branch], self.raw.q[:, branch]
        jumps = np.abs(nearest_turns(np.diff(q, axis=0), np.zeros(q.shape[1]))).max(axis=1) > _JUMP
        gaps = [np.flatnonzero(jumps & reached[1:] & reached[:-1])]
        for run, curve in self.curves(branch):
            m = self.margin(curve)
            ahead = np.abs(np.diff(m))
            side = np.sign(m[1:]) == np.sign(m[:-1])
            # by the steeper of the neighbouring slopes, the margin could pass zero and come back within the gap
            slope = np.maximum(np.r_[0.0, ahead[:-1]], np.r_[ahead[1:], 0.0]) if len(ahead) else ahead
            graze = side & (np.minimum(np.abs(m[1:]), np.abs(m[:-1])) < np.maximum(slope, ahead))
            rising = np.diff(np.abs(m))
            turns = np.r_[True, np.sign(rising[1:]) != np.sign(rising[:-1])] if len(rising) else rising > 0
            turns |= np.r_[turns[1:], True] if len(rising) else turns
            gaps.append(run.start + np.flatnonzero(graze & turns))
        return np.concatenate(gaps)

    def run(self, searches: Sequence[_Search[Result]]) -> list[Result]:
        """Run searches in parallel and return their results; the angles of all searches are solved together."""
        results: dict[int, Result] = {}
        wanted: dict[int, Array] = {}
        answers: dict[int, RawBranches | None] = dict.fromkeys(range(len(searches)))
        while answers:
            for k, answer in answers.items():
                try:
                    wanted[k] = next(searches[k]) if answer is None else searches[k].send(answer)
                except StopIteration as done:
                    results[k] = done.value
            answers = {}
            if wanted:
                raw = self.solved(np.concatenate(list(wanted.values())))
                stops = np.cumsum([len(a) for a in wanted.values()])
                ends = zip(wanted, stops.tolist(), strict=True)
                answers = {k: raw.rows(slice(stop - len(wanted[k]), stop)) for k, stop in ends}
                wanted = {}
        return [results[k] for k in range(len(searches))]

    def intervals(self, branch: int) -> Iterator[_Search[FreeInterval]]:
        """Yield searches for the parts of a branch within limits."""
        for run, curve in self.curves(branch):
            inside = self.margin(curve) >= 0.0
            for start, stop in _runs(inside, inside[1:] & inside[:-1]):
                yield self.interval(branch, run.start + start, curve[start:stop])

    def interval(self, branch: int, start: int, q: Array) -> _Search[FreeInterval]:
        """Narrow down both ends of the samples q from index `start` on."""
        first = yield from self.end(branch, start, q[0], -1)
        last = yield from self.end(branch, start + len(q) - 1, q[-1], +1)
        angles = np.concatenate([first[0], self.angles[start : start + len(q)], last[0]])
        inside = (self.angles >= angles[0]) & (self.angles <= angles[-1])
        stops = first[2], last[2]
        ends = zip(angles[[0, -1]].tolist(), stops, strict=True)
        return FreeInterval(
            BRANCH_NAMES[branch],
            frozen(angles),
            frozen(np.clip(np.concatenate([first[1], q, last[1]]), self.lower, self.upper)),
            stops,
            tuple(angle for angle, stop in ends if stop in ("reach", "singular")),
            float(self.raw.sine[inside, branch].min()),
        )

    def end(self, branch: int, sample: int, q: Array, side: int) -> _Search[tuple[Array, Array, str]]:
        """Search beyond the last feasible sample: return the furthest feasible angle and q, if any, and the stop."""
        beyond, none = sample + side, (np.zeros(0), np.zeros((0, len(q))))
        if not 0 <= beyond < len(self.angles):
            return *none, ""
        inner, outer, moved, stop = self.angles[sample], self.angles[beyond], False, "singular"
        for _ in range(_NARROWINGS):
            angles = inner + (outer - inner) * np.arange(1, _PARTS + 1) / _PARTS
            raw = yield angles
            for angle, solution, reached in zip(
                angles, nearest_turns(raw.q[:, branch], q), raw.reached[:, branch], strict=True
            ):
                stop = self.stop(solution, q, bool(reached))
                if stop:
                    outer = angle
                    break
                inner, q, moved = angle, solution, True
            else:
                break
        return *((np.array([inner]), q[None]) if moved else none), stop or "singular"

    def stop(self, q: Array, before: Array, reached: bool) -> str:
        """Return why q does not continue `before` within limits, or ""."""
        if not reached:
            return "reach"
        if np.abs(q - before).max() > _JUMP:
            return "singular"
        excess = np.maximum(self.lower - q, q - self.upper)
        joint = int(np.argmax(excess))
        if excess[joint] <= _SLACK:
            return ""
        side = "lower" if q[joint] < self.lower[joint] else "upper"
        return f"{self.robot.joint_names[joint]} {side} limit"


def _runs(on: Bools, linked: Bools) -> Iterator[tuple[int, int]]:
    """Yield the start and stop indices of each run of samples that are `on` and linked to the next."""
    start: int | None = None
    for k, is_on in enumerate(on):
        if not is_on:
            continue
        start = k if start is None else start
        if k + 1 == len(on) or not linked[k]:
            yield start, k + 1
            start = None


def _joined(intervals: list[FreeInterval]) -> list[FreeInterval]:
    """Join an interval that ends at pi with one that begins at -pi in the same configuration."""
    for a in intervals:
        for b in intervals:
            closes = a.end == np.pi and b.start == -np.pi and np.abs(a.q[-1] - b.q[0]).max() < 1e-6
            if closes and a is not b and a.length + b.length <= 2 * np.pi:
                both = replace(
                    a,
                    angles=frozen(np.concatenate([a.angles, b.angles[1:] + 2 * np.pi])),
                    q=frozen(np.concatenate([a.q, b.q[1:]])),
                    stops=(a.stops[0], b.stops[1]),
                    singular=a.singular + tuple(s + 2 * np.pi for s in b.singular),
                    least_sine=min(a.least_sine, b.least_sine),
                )
                return _joined([i for i in intervals if i is not a and i is not b] + [both])
    return sorted(intervals, key=lambda i: (round(i.start, 6), *np.round(i.q[0], 6)))
