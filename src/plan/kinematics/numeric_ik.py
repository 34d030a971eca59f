"""Inverse kinematics of any arm: the closed form where there is one, else damped least squares from many starts.

The numerical way is Levenberg-Marquardt with limits by projection (joints that press against a limit are held;
C. Kanzow, N. Yamashita, M. Fukushima, "Levenberg-Marquardt methods with strong local convergence properties for
solving nonlinear equations with convex constraints", 2004), from starts of a Halton sequence, all at once in numpy.
It is no proof: a solution whose basin holds no start is missed. Where the arm has more joints than the task has
directions the solutions are a continuum, and what comes back are points of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from arm.arguments import poses
from arm.errors import InputError
from arm.numerics.angles import arctan2
from arm.numerics.products import mul, solve_positive
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.budget import START_LOOKS, spend
from plan.kinematics.free_axis import free_sets, sample_free
from plan.kinematics.ik import (
    POSE_TOLERANCE,
    Flags,
    Indices,
    has_closed_form,
    inverse_kinematics,
    nearest_turns,
)
from plan.kinematics.product_of_exponentials import ScrewArm, screw_arm

FREE = ("x", "y", "z", "rx", "ry", "rz")
"""What may be free of a tool's pose: translation along, or rotation about, an axis of the tool frame at the pose."""

_ROTATION_SCALE = 0.2  # m per rad
_SINGULAR = 1e-6  # smallest singular value of the task's Jacobian, rotation scaled
_SAME = 1e-4  # rad or m between solutions that count as one
_BATCH = 4096  # configurations at a time


@dataclass(frozen=True)
class SearchOptions:
    """Budget of the numerical way, never in seconds.

    Attributes:
        starts: per pose.
        iterations: of every start at most.
        seed: of the starts.
        samples: with a free direction and the closed form: poses tried out of the free intervals.
    """

    starts: int = 128
    iterations: int = 40
    seed: int = 0
    samples: int = 72


@dataclass(frozen=True)
class Solutions:
    """Configurations that reach poses, in order of pose, then branch or joint values.

    Attributes:
        q: (k, n) rad, m for sliding joints.
        pose: (k,) index of the pose that each belongs to.
        branch: name of the branch of each, "" where the arm has none.
        singular: (k,) whether the task's Jacobian has lost rank.
    """

    q: Array
    pose: Indices
    branch: tuple[str, ...]
    singular: Flags

    def __len__(self) -> int:
        return len(self.q)

    def of(self, pose: int) -> Solutions:
        """The solutions of one pose."""
        rows = np.flatnonzero(self.pose == pose)
        return Solutions(
            self.q[rows], self.pose[rows], tuple(self.branch[r] for r in rows), self.singular[rows]
        )


def solve_ik(
    robot: Robot,
    T_base_tool: npt.ArrayLike,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    free: str | Sequence[str] | None = None,
    options: SearchOptions | None = None,
) -> Solutions:
    """Configurations within [lower, upper] that put the tool at the pose(s), but for what is free.

    Args:
        robot: any arm of turning and sliding joints.
        T_base_tool: (4, 4) or (m, 4, 4).
        lower, upper: (n,) rad or m.
        free: names out of `FREE`. With two rotations free, the third is the component of the rotation vector from
            the pose to the tool, in the axes of the pose.
        options: see `SearchOptions`.

    Returns:
        all solutions, whole turns included, by the closed form where the arm has one and nothing is free; with one
        free rotation, samples of every interval of `plan.kinematics.free_axis.free_sets`; else what `numeric_ik` finds.

    Raises:
        InputError: unknown names in `free`, limits of another length than the arm's, a pose that is not finite.
    """
    options = options or SearchOptions()
    names = _free_names(free)
    T = poses("T_base_tool", T_base_tool)
    turning = [name for name in names if name.startswith("r")]
    if not has_closed_form(robot) or (names and names != tuple(turning)) or len(turning) > 1:
        return numeric_ik(robot, T, lower, upper, names, options)
    if not names:
        found = inverse_kinematics(robot, T, lower, upper)
        return Solutions(found.q, found.pose, found.names(), found.singular)
    axis = names[0][1:]
    parts = []
    for pose, one in enumerate(T):
        intervals = free_sets(robot, one, lower, upper, axis)
        some = sample_free(robot, one, intervals, options.samples, axis)
        branch = tuple(intervals[i].branch for i in some.interval)
        parts.append(Solutions(some.q, np.full(len(some.q), pose, dtype=np.intp), branch, some.singular))
    return _together(parts)


def numeric_ik(
    robot: Robot,
    T_base_tool: npt.ArrayLike,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    free: str | Sequence[str] | None = None,
    options: SearchOptions | None = None,
) -> Solutions:
    """As `solve_ik`, numerically for every arm; branches have no names.

    Raises:
        InputError: as `solve_ik`.
    """
    options, arm = options or SearchOptions(), screw_arm(robot)
    T = poses("T_base_tool", T_base_tool)
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if low.shape != (len(arm.axes),) or high.shape != low.shape or not (low <= high).all():
        raise InputError(
            f"limits need a lower value not above the upper one for each of {len(arm.axes)} joints",
            lower=low.tolist(),
            upper=high.tolist(),
        )
    if not np.isfinite(T).all():
        raise InputError("a pose to reach holds a number that is not finite", poses=len(T))
    task = _Task(arm, low, high, _free_names(free))
    sequence = qmc.Halton(len(low), scramble=True, rng=np.random.default_rng(options.seed))
    starts = low + (high - low) * sequence.random(options.starts)
    parts, together = [], max(1, _BATCH // options.starts)
    for first in range(0, len(T), together):
        some = T[first : first + together]
        pose = np.repeat(np.arange(len(some)), len(starts))
        spend(START_LOOKS * len(pose))
        q, met = task.search(np.tile(starts, (len(some), 1)), some[pose], options.iterations)
        for index in range(len(some)):
            distinct = task.distinct(q[met & (pose == index)])
            singular = task.singular(distinct, some[index])
            parts.append(
                Solutions(
                    frozen(distinct),
                    np.full(len(distinct), first + index, dtype=np.intp),
                    ("",) * len(distinct),
                    singular,
                )
            )
    return _together(parts)


def _free_names(free: str | Sequence[str] | None) -> tuple[str, ...]:
    names = (free,) if isinstance(free, str) else tuple(free or ())
    unknown = [name for name in names if name not in FREE]
    if unknown:
        raise InputError(f"free = {unknown[0]!r}: must be of {', '.join(FREE)}", free=list(names))
    return tuple(name for name in FREE if name in names)


def _together(parts: Sequence[Solutions]) -> Solutions:
    return Solutions(
        frozen(np.concatenate([p.q for p in parts])),
        np.concatenate([p.pose for p in parts]),
        tuple(name for p in parts for name in p.branch),
        np.concatenate([p.singular for p in parts]),
    )


@dataclass(frozen=True, eq=False)
class _Task:
    """An arm, its limits, and which directions of a pose are asked for."""

    arm: ScrewArm
    lower: Array
    upper: Array
    free: tuple[str, ...]

    @property
    def rows(self) -> list[int]:
        """Directions that are asked for, of the 6 of `FREE`."""
        return [k for k, name in enumerate(FREE) if name not in self.free]

    @property
    def turning(self) -> npt.NDArray[np.bool_]:
        """Which joints turn (n,)."""
        return np.array([not axis.slides for axis in self.arm.axes])

    def error(self, q: Array, T: Array) -> tuple[Array, Array, Array]:
        """From the tool to the pose in the pose's axes: masked and scaled (N, r), its true size (N,), tips (N, 3)."""
        columns = self.arm.tool_columns(q)
        goal = np.moveaxis(T[:, :3], 0, -1)
        tips = columns[:, 3].T
        e = np.empty((len(q), 6))
        e[:, :3] = np.einsum("jin,jn->ni", goal[:, :3], goal[:, 3] - columns[:, 3])
        held = [k for k in range(3) if FREE[3 + k] not in self.free]
        if len(held) == 2:
            axis = 3 - sum(held)
            a, b = columns[:, axis], goal[:, axis]
            turn = np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
            cosine = (a * b).sum(axis=0)
        else:
            a, b = columns[:, :3], goal[:, :3]
            turn = 0.5 * np.stack(
                [(a[i] * b[j] - a[j] * b[i]).sum(axis=0) for i, j in ((1, 2), (2, 0), (0, 1))]
            )
            cosine = 0.5 * ((a * b).sum(axis=(0, 1)) - 1.0)
        sine = np.sqrt((turn * turn).sum(axis=0))
        angle = arctan2(sine, cosine)
        scale = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
        e[:, 3:] = np.einsum("jin,jn->ni", goal[:, :3], turn * scale)
        # at half a turn the direction is lost, and with it the size
        lost = (sine <= 1e-9) & (cosine < 0.0) & (len(held) > 0)
        size = np.where(lost, np.pi, np.abs(e[:, self.rows]).max(axis=1, initial=0.0))
        e[:, 3:] *= _ROTATION_SCALE
        return e[:, self.rows], size, tips

    def jacobian(self, q: Array, T: Array, tips: Array) -> Array:
        """Rows of `error`, per joint: (N, r, n)."""
        J = self.arm.jacobians(q, tips)
        R = np.swapaxes(T[:, :3, :3], -1, -2)
        J[:, :3], J[:, 3:] = mul(R, J[:, :3]), _ROTATION_SCALE * (mul(R, J[:, 3:]))
        return np.ascontiguousarray(J[:, self.rows])

    def search(self, starts: Array, T: Array, iterations: int) -> tuple[Array, Flags]:
        """Where each start (N, n) ends, and whether it meets its pose (N, 4, 4)."""
        # a joint that can turn all the way round has no limits to press against: whole turns are taken off later
        around = self.turning & (self.upper - self.lower >= 2 * np.pi - 1e-9)
        q, lower = starts.copy(), np.where(around, -np.inf, self.lower)
        upper = np.where(around, np.inf, self.upper)
        error, size, tips = self.error(q, T)
        damping = np.full(len(q), 1e-2)
        live = np.arange(len(q))
        for _ in range(iterations):
            live = live[(size[live] > 0.01 * POSE_TOLERANCE) & (damping[live] < 1e8)]
            if not len(live):
                break
            J, e, at = self.jacobian(q[live], T[live], tips[live]), error[live], q[live]
            pull = (mul(np.swapaxes(J, -1, -2), e[..., None]))[..., 0]
            held = ((at <= lower) & (pull < 0.0)) | ((at >= upper) & (pull > 0.0))
            J = np.where(held[:, None], 0.0, J)
            square = (e * e).sum(axis=1)
            H = mul(np.swapaxes(J, -1, -2), J)
            H += (damping[live] * np.minimum(square, 1.0) + 1e-14)[:, None, None] * np.eye(q.shape[1])
            step = solve_positive(H, np.where(held, 0.0, pull))
            step *= np.minimum(1.0, 1.0 / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
            trial = np.clip(at + step, lower, upper)
            trial_error, trial_size, trial_tips = self.error(trial, T[live])
            better = (trial_error * trial_error).sum(axis=1) < square
            kept = live[better]
            q[kept], error[kept], size[kept] = trial[better], trial_error[better], trial_size[better]
            tips[kept] = trial_tips[better]
            damping[live] = np.where(better, np.maximum(damping[live] / 5.0, 1e-6), damping[live] * 4.0)
        return q, size <= POSE_TOLERANCE

    def distinct(self, q: Array) -> Array:
        """Solutions (k, n) without repetitions, with all whole turns within limits, sorted."""
        # the first of each cluster stays, whole turns apart being the same
        chosen: list[Array] = []
        for one in q:
            apart = [
                np.where(self.turning, nearest_turns(one - c, np.zeros(len(c))), one - c) for c in chosen
            ]
            if not any(np.abs(a).max() < _SAME for a in apart):
                chosen.append(one)
        turned: list[Array] = []
        for one in chosen:
            first = np.where(self.turning, np.ceil((self.lower - 1e-12 - one) / (2 * np.pi)), 0.0)
            last = np.where(self.turning, np.floor((self.upper + 1e-12 - one) / (2 * np.pi)), 0.0)
            for turns in product(*(np.arange(a, b + 1) for a, b in zip(first, last, strict=True))):
                turned.append(np.clip(one + 2 * np.pi * np.array(turns), self.lower, self.upper))
        if not turned:
            return np.zeros((0, q.shape[1]))
        found = np.array(turned)
        ranks = np.stack([_ranks(column) for column in found.T])
        return found[np.lexsort(ranks[::-1])]

    def singular(self, q: Array, T: Array) -> Flags:
        """Whether the task's Jacobian at solutions (k, n) of one pose has lost rank."""
        if not len(q) or not self.rows:
            return np.zeros(len(q), dtype=bool)
        J = self.jacobian(q, np.broadcast_to(T, (len(q), 4, 4)), self.arm.tool_columns(q)[:, 3].T)
        return np.asarray(np.linalg.svd(J, compute_uv=False)[:, -1] < _SINGULAR)


def _ranks(values: Array) -> Indices:
    """Ranks of values, equal for those that differ by rounding only."""
    order = np.argsort(values, kind="stable")
    ranks = np.zeros(len(values), dtype=np.intp)
    ranks[order[1:]] = np.cumsum(np.diff(values[order]) > 1e-7)
    return ranks
