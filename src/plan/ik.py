"""Inverse kinematics in closed form, all branches, for arms with a spherical wrist and parallel joints 2 and 3.

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

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.robot import Robot
from arm.se3 import Array, frozen
from plan.screws import Axis, ScrewArm, screw_arm

Indices = npt.NDArray[np.intp]
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
_LIMIT_SLACK = 1e-12  # rad, so that a solution on its limit is not lost to rounding


@dataclass(frozen=True)
class RawBranches:
    """All 8 branches of m poses with no regard to joint limits; index order of `BRANCH_NAMES`.

    Attributes:
        q: (m, 8, 6) rad, each in (-pi, pi]; where not `reached`, the nearest the arm's links come.
        reached: (m, 8) whether forward kinematics of q gives the pose.
        singular: (m, 8) whether a joint was free to choose (it was set to 0), or two branches meet.
        outside: (m, 8) m by which the wrist centre is beyond what the links reach; 0 if it is not.
    """

    q: Array
    reached: Flags
    singular: Flags
    outside: Array


@dataclass(frozen=True)
class Branches:
    """Solutions inside joint limits of one or more poses, flat; in order of pose, branch, turns.

    Attributes:
        q: (k, 6) rad.
        pose: (k,) index of the pose that each belongs to.
        branch: (k,) index into `BRANCH_NAMES`.
        singular: (k,) see `RawBranches`.
    """

    q: Array
    pose: Indices
    branch: Indices
    singular: Flags

    def __len__(self) -> int:
        return len(self.q)

    def __iter__(self) -> Iterator[Array]:
        return iter(self.q)

    def names(self) -> tuple[str, ...]:
        """Branch name of every solution."""
        return tuple(BRANCH_NAMES[b] for b in self.branch)

    def of(self, pose: int) -> Branches:
        """The solutions of one pose."""
        rows = self.pose == pose
        return Branches(self.q[rows], self.pose[rows], self.branch[rows], self.singular[rows])


@dataclass(frozen=True)
class BranchReport:
    """Why one branch reaches a pose or not.

    Attributes:
        branch: its name.
        q: (6,) rad, with the whole turns that suit the limits best.
        inside: whether q reaches the pose within limits.
        joint: name of the joint furthest beyond its limits (or nearest to them, if inside).
        excess: rad by which that joint is beyond its limit; negative is the margin left.
        outside: m by which the wrist centre is beyond what the links reach (then q is only the nearest).
    """

    branch: str
    q: Array
    inside: bool
    joint: str
    excess: float
    outside: float


def inverse_kinematics(
    robot: Robot, T_base_tool: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> Branches:
    """Every configuration within [lower, upper] that puts the tool at the pose(s), whole turns included.

    Args:
        robot: a six-axis arm with a spherical wrist and joints 2 and 3 parallel.
        T_base_tool: (4, 4) or (m, 4, 4).
        lower, upper: (6,) rad.

    Raises:
        InputError: the arm is of another kind.
    """
    raw = all_branches(robot, T_base_tool)
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    first = np.ceil((lower - _LIMIT_SLACK - raw.q) / (2 * np.pi))
    turns = np.floor((upper + _LIMIT_SLACK - raw.q) / (2 * np.pi)) - first + 1
    rows = np.argwhere(raw.reached & (turns > 0).all(axis=-1))
    pose, branch = rows[:, 0], rows[:, 1]
    q = np.clip(raw.q[pose, branch] + 2 * np.pi * first[pose, branch], lower, upper)
    repeat = turns[pose, branch]
    if (repeat > 1).any():
        more = [np.array(list(product(*(range(int(c)) for c in counts)))) for counts in repeat]
        which = np.repeat(np.arange(len(rows)), [len(m) for m in more])
        pose, branch = pose[which], branch[which]
        q = np.clip(q[which] + 2 * np.pi * np.concatenate(more), lower, upper)
    return Branches(frozen(q), pose, branch, raw.singular[pose, branch])


def explain_pose(
    robot: Robot, T_base_tool: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> tuple[BranchReport, ...]:
    """What every one of the 8 branches would need for one pose (4, 4); order of `BRANCH_NAMES`.

    Raises:
        InputError: as `inverse_kinematics`.
    """
    raw = all_branches(robot, T_base_tool)
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    q = nearest_turns(raw.q[0], (lower + upper) / 2)
    excess = np.maximum(lower - q, q - upper)
    reports = []
    for index, name in enumerate(BRANCH_NAMES):
        worst = int(np.argmax(excess[index]))
        reports.append(
            BranchReport(
                branch=name,
                q=frozen(q[index]),
                inside=bool(raw.reached[0, index] and excess[index, worst] <= 0.0),
                joint=robot.joint_names[worst],
                excess=float(excess[index, worst]),
                outside=float(raw.outside[0, index]),
            )
        )
    return tuple(reports)


def nearest_turns(q: Array, reference: Array) -> Array:
    """Angles (..., 6) rad moved by whole turns to be nearest to `reference` (broadcast)."""
    return q - 2 * np.pi * np.rint((q - reference) / (2 * np.pi))


def all_branches(robot: Robot, T_base_tool: npt.ArrayLike) -> RawBranches:
    """The 8 branches of poses (m, 4, 4) or (4, 4), with no regard to joint limits.

    Raises:
        InputError: the arm is of another kind than this method solves, or a pose is not finite.
    """
    T = np.asarray(T_base_tool, dtype=float).reshape(-1, 4, 4)
    if not np.isfinite(T).all():
        raise InputError("a pose to reach holds a number that is not finite", poses=len(T))
    geometry = _wrist_arm(robot)
    raw = _closed_form(geometry, T)
    return _polished(geometry.arm, T, raw)


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
    if len(arm.axes) != 6:
        raise InputError(f"closed-form inverse kinematics needs 6 joints; this arm has {len(arm.axes)}")
    hand = arm.axes[3:]
    wrist = np.linalg.solve(sum(a.across for a in hand), sum(a.across @ a.point for a in hand))
    miss = max(float(np.linalg.norm(a.across @ (wrist - a.point))) for a in hand)
    second, third = arm.axes[1], arm.axes[2]
    skewness = float(np.linalg.norm(np.cross(second.direction, third.direction)))
    if miss > _GEOMETRY_TOLERANCE or skewness > _GEOMETRY_TOLERANCE:
        raise InputError(
            "closed-form inverse kinematics needs axes 4, 5, 6 to meet in a point and axes 2, 3 to be parallel: "
            f"here the last three miss each other by {miss * 1e3:.3g} mm and axes 2, 3 differ by "
            f"{np.degrees(skewness):.3g} deg (at most {_GEOMETRY_TOLERANCE * 1e3:g} mm, "
            f"{np.degrees(_GEOMETRY_TOLERANCE):.2g} deg)",
            wrist_miss=miss,
            skewness=skewness,
        )
    square = bool(max(abs(hand[1].direction @ a.direction) for a in (hand[0], hand[2])) < 1e-12)
    return _WristArm(arm, frozen(wrist), float(np.sign(second.direction @ third.direction)), square)


@dataclass(frozen=True)
class _TwoAngles:
    """Answers of a subproblem 4, `minus` and `plus` of the same middle; `amplitude` 0 means that any angle does."""

    minus: Array
    plus: Array
    sine: Array
    amplitude: Array


def _subproblem_1(axis: Axis, x: Array, y: Array) -> Array:
    """The angle that turns x about the axis's direction onto y, as near as it goes; vectors (..., 3)."""
    # across the axis before any product: x . y - (k . x)(k . y) loses all digits when x and y are nearly on it
    x, y = x @ axis.across, y @ axis.across
    return np.asarray(np.arctan2(np.cross(x, y) @ axis.direction, (x * y).sum(-1)))


def _subproblem_4(
    h: Array, axis: Axis, sign: float, x: Array, d: Array, root: Array | None = None
) -> _TwoAngles:
    """Both angles with h . rotation(sign * axis, angle) x = d; the nearest angle twice where d is out of reach.

    `root` is sqrt(amplitude^2 - level^2) where the caller knows it with more digits.
    """
    cosine = x @ (axis.across @ h)
    sine = sign * (x @ (axis.turn.T @ h))
    amplitude = np.hypot(cosine, sine)
    level = d - x @ (axis.along @ h)
    # (a - l)(a + l) keeps the digits that a^2 - l^2 loses near the border of the workspace
    if root is None:
        root = np.sqrt(np.maximum((amplitude - level) * (amplitude + level), 0.0))
    middle, half = np.arctan2(sine, cosine), np.arctan2(root, level)
    with np.errstate(invalid="ignore", divide="ignore"):
        edge = np.where(amplitude > 0.0, root / amplitude, 0.0)
    return _TwoAngles(middle - half, middle + half, edge, amplitude)


def _closed_form(geometry: _WristArm, T: Array) -> RawBranches:
    axes, wrist = geometry.arm.axes, geometry.wrist
    T0 = geometry.arm.T_base_tool_0
    m = len(T)
    q = np.zeros((m, 8, 6))
    singular = np.zeros((m, 8), dtype=bool)
    outside = np.zeros((m, 8))

    rotation = T[:, :3, :3] @ T0[:3, :3].T
    centre = T[:, :3, 3] + rotation @ (wrist - T0[:3, 3])
    # turning joints 2 and 3 keeps the wrist's distance along axis 2: that fixes joint 1
    lateral = axes[1].direction @ (wrist - axes[0].point)
    shoulder = _subproblem_4(axes[1].direction, axes[0], -1.0, centre - axes[0].point, np.full(m, lateral))

    upper = axes[1].across @ (axes[2].point - axes[1].point)
    fore = axes[1].across @ (wrist - axes[2].point)
    for s, q1 in enumerate((shoulder.minus, shoulder.plus)):
        turn_1 = axes[0].rotations(q1)
        seen = _turned_back(turn_1, centre - axes[0].point) + axes[0].point - axes[1].point
        # what is left along axis 2 can only be missed; across it, joint 3 sets the distance and joint 2 the direction
        sideways = np.abs(seen @ axes[1].direction - axes[1].direction @ (wrist - axes[1].point))
        flat = seen @ axes[1].across
        distance = np.linalg.norm(flat, axis=-1)
        elbow = _subproblem_4(
            upper,
            axes[2],
            1.0,
            np.broadcast_to(fore, (m, 3)),
            (distance**2 - upper @ upper - fore @ fore) / 2,
        )
        middle, span = (upper @ upper + fore @ fore) / 2, elbow.amplitude
        farthest, nearest = np.sqrt(2 * (middle + span)), np.sqrt(np.maximum(2 * (middle - span), 0.0))
        beyond = np.hypot(sideways, np.maximum(0.0, np.maximum(distance - farthest, nearest - distance)))

        up = -1.0 if s == 0 else 1.0
        for e, wanted in enumerate((up, -up)):
            q3 = elbow.minus if wanted * geometry.elbow_sign < 0 else elbow.plus
            q2 = _subproblem_1(axes[1], upper + axes[2].rotations(q3) @ fore, flat)
            turn_123 = turn_1 @ axes[1].rotations(q2) @ axes[2].rotations(q3)
            hand = np.swapaxes(turn_123, -1, -2) @ rotation
            pointing = hand @ axes[5].direction
            off_line = np.linalg.norm(np.cross(pointing, axes[3].direction), axis=-1)
            bend = _subproblem_4(
                axes[3].direction,
                axes[4],
                1.0,
                np.broadcast_to(axes[5].direction, (m, 3)),
                pointing @ axes[3].direction,
                root=off_line if geometry.square_wrist else None,
            )
            straight = off_line < SINGULAR_SINE
            for w, q5 in enumerate((bend.minus, bend.plus)):
                index = 4 * s + 2 * e + w
                turn_5 = axes[4].rotations(q5)
                q4 = np.where(straight, 0.0, _subproblem_1(axes[3], turn_5 @ axes[5].direction, pointing))
                # any vector off axis 6 shows its angle, also where 4 and 6 are in line
                mark = axes[4].direction
                q6 = _subproblem_1(
                    axes[5],
                    np.broadcast_to(mark, (m, 3)),
                    _turned_back(axes[3].rotations(q4) @ turn_5, hand @ mark),
                )
                q[:, index] = np.stack([q1, q2, q3, q4, q5, q6], axis=-1)
                outside[:, index] = beyond
                singular[:, index] = (
                    straight
                    | (shoulder.amplitude < SINGULAR_SINE)
                    | (shoulder.sine < SINGULAR_SINE)
                    | (elbow.sine < SINGULAR_SINE)
                )
    q -= 2 * np.pi * np.ceil(q / (2 * np.pi) - 0.5)
    return RawBranches(q, outside < _GEOMETRY_TOLERANCE, singular, outside)


def _turned_back(rotation: Array, vectors: Array) -> Array:
    """rotation^T v for each of (m, 3, 3) and (m, 3)."""
    return np.asarray((vectors[..., None, :] @ rotation)[..., 0, :])


def _polished(arm: ScrewArm, T: Array, raw: RawBranches) -> RawBranches:
    """Newton steps where forward kinematics is not near enough yet; what then still misses the pose is not reached."""
    pose, branch = np.nonzero(raw.reached)
    q = raw.q[pose, branch]
    wanted = T[pose]
    error = _pose_error(arm.tool_poses(q), wanted)
    best = np.abs(error).max(axis=-1)
    for _ in range(_NEWTON_STEPS):
        rows = np.flatnonzero(best > 0.1 * POSE_TOLERANCE)
        if not len(rows):
            break
        J = arm.jacobians(q[rows])
        # damped by what the pose is off, so that a singular configuration moves no joint far
        Jt = np.swapaxes(J, -1, -2)
        damping = np.minimum(best[rows] ** 2, 1e-6)[:, None, None] * np.eye(J.shape[-1])
        trial = q[rows] + (np.linalg.pinv(Jt @ J + damping) @ Jt @ error[rows][..., None])[..., 0]
        trial_error = _pose_error(arm.tool_poses(trial), wanted[rows])
        size = np.abs(trial_error).max(axis=-1)
        better = size < best[rows]
        if not better.any():
            break
        kept = rows[better]
        q[kept], error[kept], best[kept] = trial[better], trial_error[better], size[better]
    all_q, reached = raw.q.copy(), np.zeros_like(raw.reached)
    all_q[pose, branch] = q - 2 * np.pi * np.ceil(q / (2 * np.pi) - 0.5)
    reached[pose, branch] = best <= POSE_TOLERANCE
    return RawBranches(frozen(all_q), reached, raw.singular, np.where(reached, 0.0, raw.outside))


def _pose_error(T: Array, wanted: Array) -> Array:
    """Translation (m) and small-angle rotation (rad) from T to `wanted`, base axes, (m, 6)."""
    error = np.empty((len(T), 6))
    error[:, :3] = wanted[:, :3, 3] - T[:, :3, 3]
    error[:, 3:] = 0.5 * np.cross(T[:, :3, :3], wanted[:, :3, :3], axisa=1, axisb=1, axisc=1).sum(axis=2)
    return error
