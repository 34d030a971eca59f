"""The 8 branches of arms with a spherical wrist and parallel joints 2 and 3, in closed form.

The decomposition follows A. J. Elias, J. T. Wen, "IK-Geo: Unified robot inverse kinematics using subproblem
decomposition" (Mechanism and Machine Theory, 2025), case "spherical wrist, two parallel axes": every step is one of

    subproblem 1   rotation(k, angle) x = y                    one angle
    subproblem 4   h . rotation(k, angle) x = d                two angles, or none if d is out of reach

The two answers of the three subproblems 4 (joints 1, 3, 5) are the 8 branches. A branch counts as a solution only
if forward kinematics reproduces the pose; a model that is a little off the ideal geometry (a calibrated one) is
brought there by Newton steps from the ideal one's answer. For such a model, and only for it, solutions with the wrist
near axis 1 (within some 60 mm for 2 mm and 2 mrad) or with the hand in line with the forearm may be missed.
"""

from __future__ import annotations

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
from arm.se3 import Array, frozen
from plan.kinematics.product_of_exponentials import Axis, ScrewArm, screw_arm

Flags = npt.NDArray[np.bool_]

BRANCH_NAMES = tuple(
    "/".join(parts) for parts in product(("front", "back"), ("up", "down"), ("noflip", "flip"))
)
"""front: the wrist is on the side of axis 1 x axis 2; up: the elbow is above the line from shoulder to wrist;
flip: joint 5 is on the positive side of its straight position."""

POSE_TOLERANCE = 1e-10  # m and rad, of a solution's forward kinematics
SINGULAR_SINE = 1e-6  # of the angle between lines that must not be parallel, or m of the wrist from axis 1
_GEOMETRY_TOLERANCE = 0.01  # m and rad, how far a model may be off the ideal geometry for Newton to bridge it
_NEWTON_STEPS = 8
_CHUNK = 256  # poses at a time: what stays in the processor's cache


@dataclass(frozen=True)
class RawBranches:
    """All 8 branches of m poses with no regard to joint limits; index order of `BRANCH_NAMES`.

    Attributes:
        q: (m, 8, 6) rad, each in (-pi, pi]; where not `reached`, the nearest the arm's links come.
        reached: (m, 8) whether forward kinematics of q gives the pose.
        singular: (m, 8) whether a joint was free to choose (it was set to 0), or two branches meet.
        outside: (m, 8) m by which the wrist centre is beyond what the links reach; 0 if it is not.
        sine: (m, 8) how far from singular: the least of the sines of the angles between forearm and hand, between
            upper arm and forearm, and of half the turn between the two answers of joint 1.
    """

    q: Array
    reached: Flags
    singular: Flags
    outside: Array
    sine: Array


def has_closed_form(robot: Robot) -> bool:
    """Whether the arm is of the kind that is solved here."""
    try:
        _wrist_arm(robot if robot.ideal is None else robot.ideal)
    except InputError:
        return False
    return True


def all_branches(robot: Robot, T_base_tool: npt.ArrayLike, exact: bool = True) -> RawBranches:
    """The 8 branches of poses (m, 4, 4) or (4, 4), with no regard to joint limits.

    Args:
        robot: the arm.
        T_base_tool: the poses.
        exact: compare with forward kinematics, and follow a model that is off the ideal geometry; without it, which
            takes half the time, `reached` says what the ideal geometry reaches.

    Raises:
        InputError: the arm is of another kind than this method solves, or a pose is not finite.
    """
    T = np.asarray(T_base_tool, dtype=float)
    if T.ndim not in (2, 3) or T.shape[-2:] != (4, 4):
        raise InputError(
            f"T_base_tool = array of shape {T.shape}: must be (4, 4) or (m, 4, 4)", shape=list(T.shape)
        )
    T = T.reshape(-1, 4, 4)
    if not np.isfinite(T).all():
        raise InputError("a pose to reach holds a number that is not finite", poses=len(T))
    geometry = _wrist_arm(robot if robot.ideal is None else robot.ideal)
    arm = geometry.arm if robot.ideal is None else screw_arm(robot)
    exact = exact or robot.ideal is not None
    parts = []
    for first in range(0, max(len(T), 1), _CHUNK):
        some = T[first : first + _CHUNK]
        raw = _closed_form(geometry, some)
        parts.append(_polished(arm, some, raw) if exact else raw)
    if len(parts) == 1:
        return parts[0]
    return RawBranches(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(RawBranches)))


@dataclass(frozen=True, eq=False)
class _WristArm:
    """What the decomposition needs of an arm.

    Attributes:
        arm: its axes.
        wrist: the point where the last three meet, at q = 0, base frame (3,) m.
        elbow_sign: +1 if axis 3 points like axis 2, -1 if against it.
        square_wrist: whether axis 5 is at right angles to 4 and 6.
    """

    arm: ScrewArm
    wrist: Array
    elbow_sign: float
    square_wrist: bool


@lru_cache(maxsize=32)
def _wrist_arm(robot: Robot) -> _WristArm:
    arm = screw_arm(robot)
    turning = [a for a in arm.axes if not a.slides]
    if len(arm.axes) != 6 or len(turning) != 6:
        raise InputError(
            f"closed-form inverse kinematics needs 6 turning joints; this arm has {len(turning)}"
            + (f" and {len(arm.axes) - len(turning)} that slide" if len(turning) < len(arm.axes) else "")
        )
    hand = arm.axes[3:]
    wrist = solve_positive(
        np.sum([a.across for a in hand], axis=0), np.sum([mul(a.across, a.point) for a in hand], axis=0)
    )
    miss = max(float(norm(mul(a.across, wrist - a.point))) for a in hand)
    second, third = arm.axes[1], arm.axes[2]
    skewness = float(norm(np.cross(second.direction, third.direction)))
    if miss > _GEOMETRY_TOLERANCE or skewness > _GEOMETRY_TOLERANCE:
        raise InputError(
            "closed-form inverse kinematics needs axes 4, 5, 6 to meet in a point and axes 2, 3 to be parallel: "
            f"here the last three miss each other by {miss * 1e3:.3g} mm and axes 2, 3 differ by "
            f"{np.degrees(skewness):.3g} deg (at most {_GEOMETRY_TOLERANCE * 1e3:g} mm, "
            f"{np.degrees(_GEOMETRY_TOLERANCE):.2g} deg)",
            wrist_miss=miss,
            skewness=skewness,
        )
    square = bool(max(abs(mul(hand[1].direction, a.direction)) for a in (hand[0], hand[2])) < 1e-12)
    return _WristArm(arm, frozen(wrist), float(np.sign(mul(second.direction, third.direction))), square)


@dataclass(frozen=True)
class _TwoAngles:
    """Answers (2, ...) of a subproblem 4, on both sides of the same middle.

    Attributes:
        angles: middle - half, middle + half.
        sine: of half.
        amplitude: 0 means that any angle does.
    """

    angles: Array
    sine: Array
    amplitude: Array


def _subproblem_1(axis: Axis, x: Array, y: Array) -> Array:
    """The angle (...) that turns x about the axis's direction onto y, as near as it goes; columns (3, ...)."""
    # across the axis before any product: x . y - (k . x)(k . y) loses all digits when x and y are nearly on it
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
    """Both angles with h . rotation(sign * axis, angle) x = d; the nearest angle twice where d is out of reach.

    Args:
        h: (3,).
        x: (3,) or columns (3, ...).
        d: (...).
        root: sqrt(amplitude^2 - level^2) where the caller knows it with more digits.
    """
    cosine = _times(mul(h, axis.across), x)
    sine = sign * _times(mul(h, axis.turn), x)
    amplitude = np.hypot(cosine, sine)
    level = d - _times(mul(h, axis.along), x)
    # (a - l)(a + l) keeps the digits that a^2 - l^2 loses near the border of the workspace
    if root is None:
        root = np.sqrt(np.maximum((amplitude - level) * (amplitude + level), 0.0))
    middle, half = arctan2(sine, cosine), arctan2(root, level)
    with np.errstate(invalid="ignore", divide="ignore"):
        edge = np.where(amplitude > 0.0, root / amplitude, 0.0)
    return _TwoAngles(np.stack(np.broadcast_arrays(middle - half, middle + half)), edge, amplitude)


def _times(M: Array, columns: Array) -> Array:
    """M (3, 3) or (3,) by columns (3, ...)."""
    return np.asarray((mul(M, columns.reshape(3, -1))).reshape(M.shape[:-1] + columns.shape[1:]))


def _dot(x: Array, y: Array) -> Array:
    return np.asarray(x[0] * y[0] + x[1] * y[1] + x[2] * y[2])


def _turned(axis: Axis, columns: Array, angle: Array, back: bool = False) -> Array:
    """Columns (3, ...) turned by angles (...) about the axis's direction, or back."""
    return axis.turned(columns, np.cos(angle), -np.sin(angle) if back else np.sin(angle))


def _closed_form(geometry: _WristArm, T: Array) -> RawBranches:
    """All branches at once; array axes after the columns': hand w, elbow e, shoulder s, pose."""
    axes, wrist, m = geometry.arm.axes, geometry.wrist, len(T)
    T0 = geometry.arm.T_base_tool_0
    rotation = np.ascontiguousarray(np.moveaxis(mul(T[:, :3, :3], T0[:3, :3].T), 0, -1))
    centre = T[:, :3, 3].T + np.einsum("ijm,j->im", rotation, wrist - T0[:3, 3])

    # turning joints 2 and 3 keeps the wrist's distance along axis 2: that fixes joint 1
    arm = centre - axes[0].point[:, None]
    lateral = mul(axes[1].direction, wrist - axes[0].point)
    shoulder = _subproblem_4(axes[1].direction, axes[0], -1.0, arm, lateral)
    q1 = shoulder.angles

    # what is left along axis 2 can only be missed; across it, joint 3 sets the distance and joint 2 the direction
    seen = _turned(axes[0], np.repeat(arm[:, None], 2, axis=1), q1, back=True)
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
    # elbow up is the smaller angle in front (for axes 2 and 3 that point the same way), the larger one behind
    q3 = elbow.angles if geometry.elbow_sign > 0 else elbow.angles[::-1]
    q3 = np.stack([q3[:, 0], q3[::-1, 1]], axis=1)
    bent = _turned(axes[2], np.repeat(fore, 4 * m).reshape(3, 2, 2, m), q3) + upper[:, None, None, None]
    q2 = _subproblem_1(axes[1], bent, np.repeat(flat[:, None], 2, axis=1))

    # the hand against the forearm: where axis 6 points, and a vector off axis 6 that shows its angle
    mark = axes[4].direction
    hand = np.einsum("ijm,jv->ivm", rotation, np.stack([axes[5].direction, mark], axis=1))
    hand = _turned(axes[0], np.repeat(hand[:, :, None], 2, axis=2), q1, back=True)
    hand = np.repeat(hand[:, :, None], 2, axis=2)
    hand = _turned(axes[2], _turned(axes[1], hand, q2, back=True), q3, back=True)
    pointing = hand[:, 0]
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
    axis_6 = _turned(axes[4], np.repeat(axes[5].direction, 8 * m).reshape(3, 2, 2, 2, m), q5)
    q4 = np.where(straight, 0.0, _subproblem_1(axes[3], axis_6, np.repeat(hand[:, :1], 2, axis=1)))
    shown = _turned(axes[3], np.repeat(hand[:, 1:], 2, axis=1), q4, back=True)
    shown = _turned(axes[4], shown, q5, back=True)
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
    """Values per hand, elbow, shoulder, pose as (m, 8) in the order of `BRANCH_NAMES`."""
    return np.ascontiguousarray(np.transpose(np.broadcast_to(values, full), (3, 2, 1, 0)).reshape(-1, 8))


def _polished(arm: ScrewArm, T: Array, raw: RawBranches) -> RawBranches:
    """Newton steps where forward kinematics is not near enough yet; what then still misses the pose is not reached."""
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
        # damped by what the pose is off, so that a singular configuration moves no joint far
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
    """Translation (m) and small-angle rotation (rad) to `wanted`, base axes, (N, 6).

    Args:
        columns, wanted: upper rows of poses as columns, (3, 4, N).
    """
    error = np.empty((columns.shape[-1], 6))
    error[:, :3] = (wanted[:, 3] - columns[:, 3]).T
    a, b = columns[:, :3], wanted[:, :3]
    for k, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        error[:, 3 + k] = 0.5 * (a[i] * b[j] - a[j] * b[i]).sum(axis=0)
    return error
