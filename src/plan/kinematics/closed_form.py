"""Closed-form inverse kinematics of arms with a spherical wrist and parallel joints 2 and 3: 8 branches.

The decomposition follows A. J. Elias, J. T. Wen, "IK-Geo: Unified robot inverse kinematics using subproblem
decomposition" (Mechanism and Machine Theory, 2025), case "spherical wrist, two parallel axes". Each step is one of

    subproblem 1   rotation(k, angle) x = y                    one angle
    subproblem 4   h . rotation(k, angle) x = d                two angles, or none if d is out of reach

The two solutions of each of the three subproblems 4 (joints 1, 3, 5) give the 8 branches. A branch counts as a solution
only if forward kinematics reproduces the pose. For a model that deviates slightly from the ideal geometry (a calibrated
one), Newton steps start from the solution of the ideal one. Only for such a model, solutions may be missed with the
wrist near axis 1 (within about 60 mm for deviations of 2 mm and 2 mrad) or with axis 6 in line with axis 4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.numerics.angles import arctan2
from arm.numerics.products import mul, norm, solve_positive
from arm.robot.model import Robot
from arm.se3 import Array, Bools, Indices, frozen
from plan.kinematics.product_of_exponentials import Axis, ProductOfExponentials, product_of_exponentials

BRANCH_NAMES = tuple(
    "/".join(parts) for parts in product(("front", "back"), ("up", "down"), ("noflip", "flip"))
)
"""front: the wrist is on the side of axis 1 x axis 2; up: the elbow is above the line from shoulder to wrist;
flip: joint 5 is on the positive side of its straight position."""

POSE_TOLERANCE = 1e-10  # m and rad, on the forward kinematics of a solution
# singular below: sine of the angle between lines, or distance of the wrist from axis 1, m
SINGULAR_SINE = 1e-6
_GEOMETRY_TOLERANCE = 0.01  # m and rad, largest deviation from the ideal geometry
_NEWTON_STEPS = 8
_CHUNK = 256  # poses at a time, which fit into the processor's cache


@dataclass(frozen=True)
class RawBranches:
    """All 8 branches of m poses without joint limits, in the order of `BRANCH_NAMES`.

    Attributes:
        q: (m, 8, 6) rad, each in (-pi, pi]; if not `reached`, the nearest configuration.
        reached: (m, 8) whether forward kinematics of q gives the pose.
        singular: (m, 8) whether a joint is arbitrary (and set to 0), or two branches meet.
        outside: (m, 8) distance of the wrist centre beyond the reach of the links, m; 0 within reach.
        sine: (m, 8) distance from singular configurations: the smallest sine of the angle between axes 4 and 6, of the
            angle between upper arm and forearm, and of half the angle between the two solutions of joint 1.
    """

    q: Array
    reached: Bools
    singular: Bools
    outside: Array
    sine: Array

    def rows(self, rows: slice | Indices) -> RawBranches:
        """Return the branches of some of the poses."""
        return RawBranches(*(getattr(self, f.name)[rows] for f in fields(self)))

    @staticmethod
    def joined(parts: Sequence[RawBranches]) -> RawBranches:
        """Return the branches of the poses of all parts, in order."""
        return RawBranches(
            *(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(RawBranches))
        )


def has_closed_form(robot: Robot) -> bool:
    """Return whether the arm has the geometry that is solved here."""
    try:
        _wrist_arm(robot if robot.ideal is None else robot.ideal)
    except InputError:
        return False
    return True


def all_branches(robot: Robot, T_base_tool: npt.ArrayLike, exact: bool = True) -> RawBranches:
    """Return the 8 branches of poses (m, 4, 4) or (4, 4), without joint limits.

    Args:
        robot: the arm.
        T_base_tool: the poses.
        exact: check the solutions by forward kinematics. False takes half the time; `reached` then holds for the ideal
            geometry. Models that deviate from it are always checked.

    Raises:
        InputError: the arm has another geometry, or a pose is not finite.
    """
    T = np.asarray(T_base_tool, dtype=float)
    if T.ndim not in (2, 3) or T.shape[-2:] != (4, 4):
        why = f"T_base_tool = array of shape {T.shape}: must be (4, 4) or (m, 4, 4)"
        raise InputError(why, shape=list(T.shape))
    T = T.reshape(-1, 4, 4)
    if not np.isfinite(T).all():
        raise InputError("T_base_tool: a pose has a number that is not finite", poses=len(T))
    geometry = _wrist_arm(robot if robot.ideal is None else robot.ideal)
    arm = geometry.arm if robot.ideal is None else product_of_exponentials(robot)
    exact = exact or robot.ideal is not None
    parts = []
    for first in range(0, max(len(T), 1), _CHUNK):
        some = T[first : first + _CHUNK]
        raw = _closed_form(geometry, some)
        parts.append(_polished(arm, some, raw) if exact else raw)
    return parts[0] if len(parts) == 1 else RawBranches.joined(parts)


@dataclass(frozen=True, eq=False)
class _WristArm:
    """Geometry of an arm for the decomposition.

    Attributes:
        arm: its axes.
        wrist: intersection of the last three axes at q = 0, base frame (3,) m.
        elbow_sign: +1 if axes 2 and 3 have the same direction, -1 if opposite ones.
        square_wrist: whether axis 5 is perpendicular to axes 4 and 6.
    """

    arm: ProductOfExponentials
    wrist: Array
    elbow_sign: float
    square_wrist: bool


@lru_cache(maxsize=32)
def _wrist_arm(robot: Robot) -> _WristArm:
    arm = product_of_exponentials(robot)
    revolute = [a for a in arm.axes if not a.slides]
    if len(arm.axes) != 6 or len(revolute) != 6:
        raise InputError(
            f"closed-form inverse kinematics needs 6 revolute joints; this arm has {len(revolute)}"
            + (f" and {len(arm.axes) - len(revolute)} prismatic" if len(revolute) < len(arm.axes) else "")
        )
    last = arm.axes[3:]
    wrist = solve_positive(
        np.sum([a.across for a in last], axis=0), np.sum([mul(a.across, a.point) for a in last], axis=0)
    )
    miss = max(float(norm(mul(a.across, wrist - a.point))) for a in last)
    second, third = arm.axes[1], arm.axes[2]
    skewness = float(norm(np.cross(second.direction, third.direction)))
    if miss > _GEOMETRY_TOLERANCE or skewness > _GEOMETRY_TOLERANCE:
        why = (
            "closed-form inverse kinematics needs axes 4, 5, 6 that meet in a point and parallel axes 2, 3: here axes "
            f"4, 5, 6 miss each other by {miss * 1e3:.3g} mm and axes 2, 3 differ by {np.degrees(skewness):.3g} deg "
            f"(at most {_GEOMETRY_TOLERANCE * 1e3:g} mm, {np.degrees(_GEOMETRY_TOLERANCE):.2g} deg)"
        )
        raise InputError(why, wrist_miss=miss, skewness=skewness)
    square = bool(max(abs(mul(last[1].direction, a.direction)) for a in (last[0], last[2])) < 1e-12)
    return _WristArm(arm, frozen(wrist), float(np.sign(mul(second.direction, third.direction))), square)


@dataclass(frozen=True)
class _TwoAngles:
    """The two solutions (2, ...) of a subproblem 4.

    Attributes:
        angles: middle - half, middle + half.
        sine: sine of half.
        amplitude: 0 if any angle is a solution.
    """

    angles: Array
    sine: Array
    amplitude: Array


def _subproblem_1(axis: Axis, x: Array, y: Array) -> Array:
    """Return the angle (...) that rotates x about the axis direction onto y, or nearest to it; columns (3, ...)."""
    # project across the axis first: x . y - (k . x)(k . y) loses all digits if x and y are nearly on it
    x, y = _times(axis.across, x), _times(axis.across, y)
    k = axis.direction
    sine = (
        k[0] * (x[1] * y[2] - x[2] * y[1])
        + k[1] * (x[2] * y[0] - x[0] * y[2])
        + k[2] * (x[0] * y[1] - x[1] * y[0])
    )
    return arctan2(sine, _dot(x, y))


def _subproblem_4(
    h: Array, axis: Axis, sign: float, x: Array, d: Array | float, root: Array | None = None
) -> _TwoAngles:
    """Return both angles with h . rotation(sign * axis, angle) x = d; the nearest angle twice if d is out of reach.

    Args:
        h: (3,).
        axis: rotation axis.
        sign: sign of its direction.
        x: (3,) or columns (3, ...).
        d: (...).
        root: sqrt(amplitude^2 - level^2) if the caller has it with more digits.
    """
    cosine = _times(mul(h, axis.across), x)
    sine = sign * _times(mul(h, axis.turn), x)
    amplitude = np.hypot(cosine, sine)
    level = d - _times(mul(h, axis.along), x)
    # (a - l)(a + l) keeps the digits that a^2 - l^2 loses near the workspace boundary
    if root is None:
        root = np.sqrt(np.maximum((amplitude - level) * (amplitude + level), 0.0))
    middle, half = arctan2(sine, cosine), arctan2(root, level)
    with np.errstate(invalid="ignore", divide="ignore"):
        edge = np.where(amplitude > 0.0, root / amplitude, 0.0)
    return _TwoAngles(np.stack(np.broadcast_arrays(middle - half, middle + half)), edge, amplitude)


def _times(M: Array, columns: Array) -> Array:
    """Multiply M (3, 3) or (3,) by columns (3, ...)."""
    return np.asarray((mul(M, columns.reshape(3, -1))).reshape(M.shape[:-1] + columns.shape[1:]))


def _dot(x: Array, y: Array) -> Array:
    return np.asarray(x[0] * y[0] + x[1] * y[1] + x[2] * y[2])


def _rotated(axis: Axis, columns: Array, angle: Array, back: bool = False) -> Array:
    """Rotate columns (3, ...) by angles (...) about the axis direction, or back."""
    return axis.turned(columns, np.cos(angle), -np.sin(angle) if back else np.sin(angle))


def _closed_form(geometry: _WristArm, T: Array) -> RawBranches:
    """Compute all branches at once; array axes after that of the columns: wrist, elbow, shoulder, pose."""
    axes, wrist, m = geometry.arm.axes, geometry.wrist, len(T)
    T0 = geometry.arm.T_base_tool_0
    rotation = np.ascontiguousarray(np.moveaxis(mul(T[:, :3, :3], T0[:3, :3].T), 0, -1))
    centre = T[:, :3, 3].T + np.einsum("ijm,j->im", rotation, wrist - T0[:3, 3])

    # joints 2 and 3 do not move the wrist along axis 2: that determines joint 1
    arm = centre - axes[0].point[:, None]
    lateral = mul(axes[1].direction, wrist - axes[0].point)
    shoulder = _subproblem_4(axes[1].direction, axes[0], -1.0, arm, lateral)
    q1 = shoulder.angles

    # an error along axis 2 remains; across it, joint 3 sets the distance and joint 2 the direction
    seen = _rotated(axes[0], np.repeat(arm[:, None], 2, axis=1), q1, back=True)
    seen += (axes[0].point - axes[1].point)[:, None, None]
    sideways = np.abs(_times(axes[1].direction, seen) - mul(axes[1].direction, wrist - axes[1].point))
    flat = _times(axes[1].across, seen)
    upper = mul(axes[1].across, axes[2].point - axes[1].point)
    fore = mul(axes[1].across, wrist - axes[2].point)
    middle = (mul(upper, upper) + mul(fore, fore)) / 2
    distance = np.sqrt(_dot(flat, flat))
    elbow = _subproblem_4(upper, axes[2], 1.0, fore, distance**2 / 2 - middle)
    farthest = np.sqrt(2 * (middle + elbow.amplitude))
    nearest = np.sqrt(np.maximum(2 * (middle - elbow.amplitude), 0.0))
    beyond = np.hypot(sideways, np.maximum(0.0, np.maximum(distance - farthest, nearest - distance)))
    # elbow up is the smaller angle in front and the larger one behind, if axes 2 and 3 have the same direction
    q3 = elbow.angles if geometry.elbow_sign > 0 else elbow.angles[::-1]
    q3 = np.stack([q3[:, 0], q3[::-1, 1]], axis=1)
    bent = _rotated(axes[2], np.repeat(fore, 4 * m).reshape(3, 2, 2, m), q3) + upper[:, None, None, None]
    q2 = _subproblem_1(axes[1], bent, np.repeat(flat[:, None], 2, axis=1))

    # in the frame of the forearm: the direction of axis 6, and a vector off axis 6 that gives its angle
    mark = axes[4].direction
    last_link = np.einsum("ijm,jv->ivm", rotation, np.stack([axes[5].direction, mark], axis=1))
    last_link = _rotated(axes[0], np.repeat(last_link[:, :, None], 2, axis=2), q1, back=True)
    last_link = np.repeat(last_link[:, :, None], 2, axis=2)
    last_link = _rotated(axes[2], _rotated(axes[1], last_link, q2, back=True), q3, back=True)
    pointing = last_link[:, 0]
    off = _times(axes[3].across, pointing)
    off_line = np.sqrt(_dot(off, off))
    bend = _subproblem_4(
        axes[3].direction,
        axes[4],
        1.0,
        axes[5].direction,
        _times(axes[3].direction, pointing),
        root=off_line if geometry.square_wrist else None,
    )
    q5 = bend.angles
    straight = off_line < SINGULAR_SINE
    axis_6 = _rotated(axes[4], np.repeat(axes[5].direction, 8 * m).reshape(3, 2, 2, 2, m), q5)
    q4 = np.where(straight, 0.0, _subproblem_1(axes[3], axis_6, np.repeat(last_link[:, :1], 2, axis=1)))
    shown = _rotated(axes[3], np.repeat(last_link[:, 1:], 2, axis=1), q4, back=True)
    shown = _rotated(axes[4], shown, q5, back=True)
    q6 = _subproblem_1(axes[5], np.repeat(mark, 8 * m).reshape(3, 2, 2, 2, m), shown)

    full = (2, 2, 2, m)
    q = np.stack([np.broadcast_to(part, full) for part in (q1, q2, q3, q4, q5, q6)])
    q -= 2 * np.pi * np.ceil(q / (2 * np.pi) - 0.5)
    sine = np.minimum(off_line, np.minimum(shoulder.sine, elbow.sine))
    singular = straight | (shoulder.amplitude < SINGULAR_SINE) | (sine < SINGULAR_SINE)
    return RawBranches(
        np.ascontiguousarray(np.transpose(q, (4, 3, 2, 1, 0)).reshape(m, 8, 6)),
        _by_pose(beyond < _GEOMETRY_TOLERANCE, full),
        _by_pose(singular, full),
        _by_pose(beyond, full),
        _by_pose(np.where(shoulder.amplitude < SINGULAR_SINE, 0.0, sine), full),
    )


def _by_pose(values: npt.NDArray[Any], full: tuple[int, ...]) -> npt.NDArray[Any]:
    """Reorder values per wrist, elbow, shoulder, pose to (m, 8) in the order of `BRANCH_NAMES`."""
    return np.ascontiguousarray(np.transpose(np.broadcast_to(values, full), (3, 2, 1, 0)).reshape(-1, 8))


def _polished(arm: ProductOfExponentials, T: Array, raw: RawBranches) -> RawBranches:
    """Refine solutions by Newton steps; those that then still miss the pose are not `reached`."""
    pose, branch = np.nonzero(raw.reached)
    q = raw.q[pose, branch]
    wanted = np.moveaxis(T[:, :3], 0, -1)[..., pose]
    error = pose_error(arm.tool_columns(q), wanted)
    best = np.abs(error).max(axis=-1)
    for _ in range(_NEWTON_STEPS):
        rows = np.flatnonzero(best > 0.1 * POSE_TOLERANCE)
        if not len(rows):
            break
        J = arm.jacobians(q[rows])
        # damping by the pose error, so that no joint moves far near a singular configuration
        Jt = np.swapaxes(J, -1, -2)
        damping = np.minimum(best[rows] ** 2, 1e-6)[:, None, None] * np.eye(J.shape[-1])
        trial = q[rows] + solve_positive(mul(Jt, J) + damping, mul(Jt, error[rows][..., None])[..., 0])
        trial_error = pose_error(arm.tool_columns(trial), wanted[..., rows])
        size = np.abs(trial_error).max(axis=-1)
        better = size < best[rows]
        if not better.any():
            break
        kept = rows[better]
        q[kept], error[kept], best[kept] = trial[better], trial_error[better], size[better]
    all_q, reached = raw.q.copy(), np.zeros_like(raw.reached)
    all_q[pose, branch] = q - 2 * np.pi * np.ceil(q / (2 * np.pi) - 0.5)
    reached[pose, branch] = best <= POSE_TOLERANCE
    return RawBranches(
        frozen(all_q), reached, raw.singular, np.where(reached, 0.0, raw.outside), frozen(raw.sine)
    )


def pose_error(columns: Array, wanted: Array) -> Array:
    """Return translation (m) and small-angle rotation (rad) to `wanted`, in base axes, (N, 6).

    Args:
        columns, wanted: upper rows of poses as columns, (3, 4, N).
    """
    error = np.empty((columns.shape[-1], 6))
    error[:, :3] = (wanted[:, 3] - columns[:, 3]).T
    a, b = columns[:, :3], wanted[:, :3]
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        error[:, 3 + k] = 0.5 * (a[i] * b[j] - a[j] * b[i]).sum(axis=0)
    return error
