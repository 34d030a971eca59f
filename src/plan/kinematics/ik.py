"""Inverse kinematics of spherical-wrist arms: every solution within limits, or why a pose has none.

`plan.kinematics.closed_form` computes the branches; this module applies whole revolutions and limits.
`plan.kinematics.numeric_ik.solve_ik` works for any arm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from arm.arguments import joints, poses
from arm.errors import InputError
from arm.former import former_names
from arm.robot.model import Robot
from arm.se3 import Array, Bools, Indices, frozen
from plan.kinematics.closed_form import BRANCH_NAMES, all_branches

_LIMIT_SLACK = 1e-12  # rad, so that rounding loses no solution on a limit


@dataclass(frozen=True)
class Branches:
    """k solutions of one or more poses within joint limits, ordered by pose, branch, revolutions.

    Attributes:
        q: (k, 6) rad.
        pose: (k,) index of the pose.
        branch: (k,) index into `BRANCH_NAMES`.
        singular: (k,) see `RawBranches`.
    """

    q: Array
    pose: Indices
    branch: Indices
    singular: Bools

    def __len__(self) -> int:
        return len(self.q)

    def __iter__(self) -> Iterator[Array]:
        return iter(self.q)

    def names(self) -> tuple[str, ...]:
        """Return the branch name of every solution."""
        return tuple(BRANCH_NAMES[b] for b in self.branch)

    def of(self, pose: int) -> Branches:
        """Return the solutions of one pose."""
        rows = self.pose == pose
        return Branches(self.q[rows], self.pose[rows], self.branch[rows], self.singular[rows])


@dataclass(frozen=True)
class BranchReport:
    """How one branch reaches a pose, or why it does not.

    Attributes:
        branch: its name.
        q: (6,) rad, with each joint in the revolution nearest to the middle of its range.
        inside: whether q reaches the pose within limits.
        joint: name of the joint furthest beyond its limits (or nearest to them, if inside).
        excess: amount by which that joint exceeds its limit, rad; negative within the limit.
        outside: distance of the wrist centre beyond the reach of the links, m (q is then the nearest configuration).
    """

    branch: str
    q: Array
    inside: bool
    joint: str
    excess: float
    outside: float

    @property
    def miss(self) -> tuple[float, float]:
        """How far the branch is from the pose, to compare branches: `outside` first, then `excess`."""
        return round(self.outside, 9), round(self.excess, 9)

    def why(self) -> str:
        """Return what keeps this branch from its pose, for a message."""
        if self.outside > 0.0:
            return f"the wrist would have to be {1e3 * self.outside:.1f} mm further than the links reach"
        return f"{self.branch} has joint {self.joint} {np.degrees(self.excess):.1f} deg beyond its limit"


def inverse_kinematics(
    robot: Robot, T_base_tool: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> Branches:
    """Return every configuration within [lower, upper] that reaches the pose(s), including whole revolutions.

    Args:
        robot: a six-axis arm with a spherical wrist and parallel joints 2 and 3.
        T_base_tool: (4, 4) or (m, 4, 4).
        lower, upper: (6,) rad.

    Raises:
        InputError: the arm has another geometry, a pose is not 4x4 and rigid to 1e-6, or limits are not six numbers.
    """
    raw = all_branches(robot, poses("T_base_tool", T_base_tool))
    lower, upper = joints("lower", lower, robot.joint_names), joints("upper", upper, robot.joint_names)
    first = np.ceil((lower - _LIMIT_SLACK - raw.q) / (2 * np.pi))
    revolutions = np.floor((upper + _LIMIT_SLACK - raw.q) / (2 * np.pi)) - first + 1
    rows = np.argwhere(raw.reached & (revolutions > 0).all(axis=-1))
    pose, branch = rows[:, 0], rows[:, 1]
    q = np.clip(raw.q[pose, branch] + 2 * np.pi * first[pose, branch], lower, upper)
    repeat = revolutions[pose, branch]
    if (repeat > 1).any():
        more = [np.array(list(product(*(range(int(c)) for c in counts)))) for counts in repeat]
        which = np.repeat(np.arange(len(rows)), [len(m) for m in more])
        pose, branch = pose[which], branch[which]
        q = np.clip(q[which] + 2 * np.pi * np.concatenate(more), lower, upper)
    return Branches(frozen(q), pose, branch, raw.singular[pose, branch])


def explain_pose(
    robot: Robot, T_base_tool: npt.ArrayLike, lower: npt.ArrayLike, upper: npt.ArrayLike
) -> tuple[BranchReport, ...]:
    """Report for one pose (4, 4) what each of the 8 branches needs, in the order of `BRANCH_NAMES`.

    Raises:
        InputError: as `inverse_kinematics`.
    """
    T = poses("T_base_tool", T_base_tool)
    if len(T) != 1:
        raise InputError(f"T_base_tool: {len(T)} poses; must be one, 4x4", poses=len(T))
    raw = all_branches(robot, T)
    lower, upper = joints("lower", lower, robot.joint_names), joints("upper", upper, robot.joint_names)
    q = nearest_turns(raw.q[0], (lower + upper) / 2)
    excess = np.maximum(lower - q, q - upper)
    worst = np.argmax(excess, axis=1).tolist()
    return tuple(
        BranchReport(
            branch=name,
            q=frozen(q[index]),
            inside=bool(raw.reached[0, index] and excess[index, joint] <= 0.0),
            joint=robot.joint_names[joint],
            excess=float(excess[index, joint]),
            outside=float(raw.outside[0, index]),
        )
        for index, (name, joint) in enumerate(zip(BRANCH_NAMES, worst, strict=True))
    )


def nearest_turns(q: Array, reference: Array) -> Array:
    """Shift angles (..., 6) rad by whole revolutions to be nearest to `reference` (broadcast)."""
    return q - 2 * np.pi * np.rint((q - reference) / (2 * np.pi))


former_names(__name__, "plan.kinematics.closed_form", "POSE_TOLERANCE", "RawBranches", "has_closed_form")
