"""Inverse kinematics of any arm: closed form if there is one, else damped least squares from many starts.

The numerical method is Levenberg-Marquardt with projection onto the limits (joints that press against a limit are
fixed; C. Kanzow, N. Yamashita, M. Fukushima, "Levenberg-Marquardt methods with strong local convergence properties for
solving nonlinear equations with convex constraints", 2004). It starts from a Halton sequence, all starts at once in
numpy. It misses solutions whose basin contains no start. For redundant arms the solutions form a continuum, and the
result is a set of points on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from arm.arguments import poses
from arm.errors import InputError
from arm.numerics.angles import arctan2
from arm.numerics.products import mul, solve_positive
from arm.robot.model import Robot
from arm.se3 import Array, Bools, Indices, frozen
from plan.budget import START_CHECKS, spend
from plan.kinematics.closed_form import POSE_TOLERANCE, has_closed_form
from plan.kinematics.free_axis import feasible_intervals, sample_free
from plan.kinematics.ik import inverse_kinematics, nearest_turns
from plan.kinematics.product_of_exponentials import ProductOfExponentials, product_of_exponentials

FREE = ("x", "y", "z", "rx", "ry", "rz")
"""Directions of a pose that may be free: translation along or rotation about an axis of the tool frame there."""

_ROTATION_SCALE = 0.2  # m per rad
_SINGULAR = 1e-6  # smallest singular value of the task's Jacobian, rotation scaled
_SAME = 1e-4  # rad or m between solutions that count as one
_BATCH = 4096  # configurations computed together
_PATIENCE = 5  # iterations in a row that do not halve the squared error: such a start leads nowhere
_CHOICE = 32  # configurations for every start: of these, the nearest to the pose are started from


@dataclass(frozen=True)
class SearchOptions:
    """Budget of the numerical method, in counts instead of seconds.

    Attributes:
        starts: starts for each pose.
        iterations: most iterations of each start.
        seed: seed of the starts.
        samples: number of poses from the free intervals, with one free rotation and a closed form.
        poses: number of poses that are tried of a goal that is free within limits (`plan.kinematics.freedom`).
    """

    starts: int = 128
    iterations: int = 40
    seed: int = 0
    samples: int = 72
    poses: int = 32


@dataclass(frozen=True)
class Solutions:
    """k configurations that reach poses, ordered by pose, then branch or joint values.

    Attributes:
        q: (k, n) rad, m for prismatic joints.
        pose: (k,) index of the pose.
        branch: (k,) names of the branches, "" without closed form.
        singular: (k,) whether the task's Jacobian loses rank.
    """

    q: Array
    pose: Indices
    branch: tuple[str, ...]
    singular: Bools

    @classmethod
    def at(cls, q: Array) -> Solutions:
        """Return one configuration (n,), which no pose asks for."""
        return cls(q[None], np.zeros(1, dtype=np.intp), ("",), np.zeros(1, dtype=bool))

    def __len__(self) -> int:
        return len(self.q)

    def of(self, pose: int) -> Solutions:
        """Return the solutions of one pose."""
        return self.rows(np.flatnonzero(self.pose == pose))

    def rows(self, rows: Indices) -> Solutions:
        """Return some solutions, in the order of `rows` (m,)."""
        branch = tuple(self.branch[row] for row in rows.tolist())
        return Solutions(self.q[rows], self.pose[rows], branch, self.singular[rows])


def solve_ik(
    robot: Robot,
    T_base_tool: npt.ArrayLike,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    free: str | Sequence[str] | None = None,
    options: SearchOptions | None = None,
) -> Solutions:
    """Return configurations within [lower, upper] that reach the pose(s) except in free directions.

    Args:
        robot: any arm of revolute and prismatic joints.
        T_base_tool: (4, 4) or (m, 4, 4).
        lower, upper: (n,) rad or m.
        free: names from `FREE`. With two free rotations, the third is the component of the rotation vector from the
            pose to the tool, in the axes of the pose.
        options: see `SearchOptions`.

    Returns:
        If the arm has a closed form: all solutions with whole revolutions if nothing is free, or samples of every
        interval of `plan.kinematics.free_axis.feasible_intervals` for one free rotation. Else the result of
        `numeric_ik`.

    Raises:
        InputError: unknown names in `free`, limits with another number of joints than the arm, or a pose that is not
            rigid.
    """
    options = options or SearchOptions()
    names = _free_names(free)
    T = poses("T_base_tool", T_base_tool)
    rotations = [name for name in names if name.startswith("r")]
    if not has_closed_form(robot) or (names and names != tuple(rotations)) or len(rotations) > 1:
        return numeric_ik(robot, T, lower, upper, names, options)
    if not names:
        found = inverse_kinematics(robot, T, lower, upper)
        return Solutions(found.q, found.pose, found.names(), found.singular)
    axis = names[0][1:]
    parts = []
    for pose, one in enumerate(T):
        intervals = feasible_intervals(robot, one, lower, upper, axis)
        q, interval, singular = sample_free(robot, one, intervals, options.samples, axis)
        branch = tuple(intervals[i].branch for i in interval)
        parts.append(Solutions(q, np.full(len(q), pose, dtype=np.intp), branch, singular))
    return _together(parts)


def numeric_ik(
    robot: Robot,
    T_base_tool: npt.ArrayLike,
    lower: npt.ArrayLike,
    upper: npt.ArrayLike,
    free: str | Sequence[str] | None = None,
    options: SearchOptions | None = None,
) -> Solutions:
    """Solve as `solve_ik`, but numerically for every arm; branches have no names.

    Raises:
        InputError: as `solve_ik`.
    """
    options, arm = options or SearchOptions(), product_of_exponentials(robot)
    T = poses("T_base_tool", T_base_tool)
    low, high = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if low.shape != (len(arm.axes),) or high.shape != low.shape or not (low <= high).all():
        why = f"lower, upper: must be {len(arm.axes)} numbers each, one per joint, lower not above upper"
        raise InputError(why, lower=low.tolist(), upper=high.tolist())
    task = _Task(arm, low, high, _free_names(free))
    pool = _pool(arm, tuple(low.tolist()), tuple(high.tolist()), options.starts, options.seed)
    parts, together = [], max(1, _BATCH // options.starts)
    for first in range(0, len(T), together):
        some = T[first : first + together]
        pose = np.repeat(np.arange(len(some)), options.starts)
        spend(START_CHECKS * len(pose))
        starts = np.concatenate([task.nearest(pool, one, options.starts) for one in some])
        q, met = task.search(starts, some[pose], options.iterations)
        for index in range(len(some)):
            apart = task.apart(q[met & (pose == index)])
            distinct, of = task.turned(apart)
            singular = task.singular(apart, some[index])[of]
            of_pose = np.full(len(distinct), first + index, dtype=np.intp)
            parts.append(Solutions(frozen(distinct), of_pose, ("",) * len(distinct), singular))
    return _together(parts)


def solutions_near(
    robot: Robot,
    q: Array,
    T_base_tool: Array,
    lower: Array,
    upper: Array,
    free: str | Sequence[str] | None = None,
    iterations: int = 15,
) -> tuple[Array, Bools]:
    """Return the configurations (k, n) that starts q (k, n) lead to by the numerical method, and whether they reach
    their poses (k, 4, 4) within limits, all together.

    Raises:
        InputError: unknown names in `free`.
    """
    spend(START_CHECKS * len(q) * iterations / SearchOptions.iterations)
    task = _Task(product_of_exponentials(robot), lower, upper, _free_names(free))
    found, met = task.search(q, T_base_tool, iterations)
    inside = (found >= lower - 1e-12).all(axis=1) & (found <= upper + 1e-12).all(axis=1)
    return found, met & inside


@lru_cache(maxsize=16)
def _pool(
    arm: ProductOfExponentials, lower: tuple[float, ...], upper: tuple[float, ...], starts: int, seed: int
) -> tuple[Array, Array]:
    """Return a Halton sequence of `_CHOICE` configurations for every start, and the tools there as columns (3, 4, N).

    Cached, since all poses share it.
    """
    from scipy.stats import qmc  # slow to import

    low, high = np.array(lower), np.array(upper)
    sequence = qmc.Halton(len(low), scramble=True, rng=np.random.default_rng(seed))
    q = low + (high - low) * sequence.random(_CHOICE * starts)
    return frozen(q), frozen(arm.tool_columns(q))


def _free_names(free: str | Sequence[str] | None) -> tuple[str, ...]:
    names = (free,) if isinstance(free, str) else tuple(free or ())
    unknown = [name for name in names if name not in FREE]
    if unknown:
        raise InputError(f"free = {unknown[0]!r}: must be one of {', '.join(FREE)}", free=list(names))
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
    """An arm, its limits, and the free directions of its poses."""

    arm: ProductOfExponentials
    lower: Array
    upper: Array
    free: tuple[str, ...]

    @property
    def rows(self) -> list[int]:
        """Indices into `FREE` of the directions that are not free."""
        return [k for k, name in enumerate(FREE) if name not in self.free]

    @property
    def revolute(self) -> Bools:
        """Flags (n,) of the revolute joints."""
        return np.array([not axis.slides for axis in self.arm.axes])

    def nearest(self, pool: tuple[Array, Array], T: Array, count: int) -> Array:
        """Return the `count` configurations of a `_pool` with the smallest error from one pose (4, 4)."""
        q, columns = pool
        error, _ = self.deviation(columns, np.broadcast_to(T, (len(q), 4, 4)))
        order = np.argsort(np.round((error * error).sum(axis=1), 9), kind="stable")
        return q[order[:count]]

    def error(self, q: Array, T: Array) -> tuple[Array, Array, Array]:
        """Return `deviation` at configurations (N, n), and the tips (N, 3)."""
        columns = self.arm.tool_columns(q)
        return *self.deviation(columns, T), columns[:, 3].T

    def deviation(self, columns: Array, T: Array) -> tuple[Array, Array]:
        """Return the error from tools (3, 4, N) to poses in the poses' axes, scaled (N, r); and its true size (N,)."""
        goal = np.moveaxis(T[:, :3], 0, -1)
        e = np.empty((len(T), 6))
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
        # a rotation by pi has no unique axis
        lost = (sine <= 1e-9) & (cosine < 0.0) & (len(held) > 0)
        size = np.where(lost, np.pi, np.abs(e[:, self.rows]).max(axis=1, initial=0.0))
        e[:, 3:] *= _ROTATION_SCALE
        return e[:, self.rows], size

    def jacobian(self, q: Array, T: Array, tips: Array) -> Array:
        """Return the Jacobian of `error`, (N, r, n)."""
        J = self.arm.jacobians(q, tips)
        R = np.swapaxes(T[:, :3, :3], -1, -2)
        J[:, :3], J[:, 3:] = mul(R, J[:, :3]), _ROTATION_SCALE * (mul(R, J[:, 3:]))
        return np.ascontiguousarray(J[:, self.rows])

    def search(self, starts: Array, T: Array, iterations: int) -> tuple[Array, Bools]:
        """Return where each start (N, n) ends, and whether it reaches its pose (N, 4, 4)."""
        # ignore the limits of joints with a full circle; `distinct` shifts by whole revolutions
        around = self.revolute & (self.upper - self.lower >= 2 * np.pi - 1e-9)
        q, lower = starts.copy(), np.where(around, -np.inf, self.lower)
        upper = np.where(around, np.inf, self.upper)
        error, size, tips = self.error(q, T)
        damping, slow = np.full(len(q), 1e-2), np.zeros(len(q), dtype=np.intp)
        live = np.arange(len(q))
        for _ in range(iterations):
            live = live[(size[live] > 0.01 * POSE_TOLERANCE) & (slow[live] < _PATIENCE)]
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
            left = (trial_error * trial_error).sum(axis=1)
            better, slow[live] = left < square, np.where(left < 0.5 * square, 0, slow[live] + 1)
            kept = live[better]
            q[kept], error[kept], size[kept] = trial[better], trial_error[better], trial_size[better]
            tips[kept] = trial_tips[better]
            damping[live] = np.where(better, np.maximum(damping[live] / 5.0, 1e-6), damping[live] * 4.0)
        return q, size <= POSE_TOLERANCE

    def apart(self, q: Array) -> Array:
        """Return the first of each cluster of solutions (k, n), modulo whole revolutions."""
        chosen, left = [q[:0]], q
        while len(left):
            chosen.append(left[:1])
            step = left - left[0]
            step = np.where(self.revolute, nearest_turns(step, np.zeros(q.shape[1])), step)
            left = left[np.abs(step).max(axis=1) >= _SAME]
        return np.concatenate(chosen)

    def turned(self, q: Array) -> tuple[Array, Indices]:
        """Return solutions (k, n) in every revolution within limits, sorted; and which of them each was (m,)."""
        found, of = q, np.arange(len(q))
        for k in np.flatnonzero(self.revolute).tolist() if len(found) else ():
            low, high = self.lower[k] - 1e-12, self.upper[k] + 1e-12
            first = int(np.ceil((low - found[:, k].max()) / (2 * np.pi)))
            last = int(np.floor((high - found[:, k].min()) / (2 * np.pi)))
            turned = [
                found + 2 * np.pi * turn * (np.arange(q.shape[1]) == k) for turn in range(first, last + 1)
            ]
            every = np.concatenate([found[:0], *turned])
            inside = (low <= every[:, k]) & (every[:, k] <= high)
            found, of = every[inside], np.tile(of, len(turned))[inside]
        found = np.clip(found, self.lower, self.upper)
        order = np.lexsort(np.stack([_ranks(column) for column in found.T])[::-1])
        return found[order], of[order]

    def singular(self, q: Array, T: Array) -> Bools:
        """Return whether the task's Jacobian loses rank at solutions (k, n) of one pose."""
        if not len(q) or not self.rows:
            return np.zeros(len(q), dtype=bool)
        J = self.jacobian(q, np.broadcast_to(T, (len(q), 4, 4)), self.arm.tool_columns(q)[:, 3].T)
        return np.asarray(np.linalg.svd(J, compute_uv=False)[:, -1] < _SINGULAR)


def _ranks(values: Array) -> Indices:
    """Return ranks of values, equal for values that differ only by rounding."""
    order = np.argsort(values, kind="stable")
    ranks = np.zeros(len(values), dtype=np.intp)
    ranks[order[1:]] = np.cumsum(np.diff(values[order]) > 1e-7)
    return ranks
