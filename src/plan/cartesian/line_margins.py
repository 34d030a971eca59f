"""How much room straight lines of an arm with a closed form leave its joints, for many lines at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.robot.model import Robot
from arm.se3 import Array
from plan.kinematics.closed_form import BRANCH_NAMES, all_branches
from plan.kinematics.ik import nearest_turns

# m between poses along a line; joints move smoothly between them, away from singularities
_SAMPLE_STEP = 0.005
_NEAR = 1e-7  # m, from which a pose that was not checked counts as reached


@dataclass(frozen=True)
class LineMargins:
    """Room of k lines on each of the 8 branches.

    Attributes:
        lines: (k, m, 4, 4) poses of the tool at even distances, from the end of each line backwards.
        q: (k, m, 8, n) rad, continuous along each line.
        margin: (k, 8) smallest distance of a joint from its limits, rad; negative beyond a limit.
        joint: (k, 8) index of that joint.
        outside: (k, 8) largest distance of the line beyond the reach of the links, m; 0 within reach.
        racing: (k, 8) index of a joint that would exceed its velocity limit even at the slowest tool speed, or -1.
        worst: (k, 8) index of the pose where the line misses most, or has least room.
    """

    lines: Array
    q: Array
    margin: Array
    joint: Array
    outside: Array
    racing: Array
    worst: Array

    @property
    def ok(self) -> Array:
        """(k, 8) whether the arm can follow the line on the branch."""
        return np.asarray((self.margin >= 0.0) & (self.outside == 0.0) & (self.racing < 0))


def heights_of(length: float) -> Array:
    """Return the distances (m,) from the end of a line of some length at which its poses are tried, m."""
    return np.linspace(0.0, length, max(2, int(np.ceil(length / _SAMPLE_STEP - 1e-9)) + 1))


def line_margins(
    robot: Robot, limits: Limits, ends: Array, heights: Array, slowest: float, exact: bool = True
) -> LineMargins:
    """Try lines on all branches.

    Args:
        robot: an arm with a closed form.
        limits: limits of position, and of velocity for joints near a singularity.
        ends: (k, 4, 4) T_base_tool at the ends of the lines, which come along the tool's z.
        heights: (m,) even distances from the ends, m; see `heights_of`.
        slowest: tool speed that the joints must allow, m/s.
        exact: see `plan.kinematics.closed_form.all_branches`.
    """
    lines = np.repeat(ends[:, None], len(heights), axis=1)
    lines[:, :, :3, 3] -= heights[:, None] * ends[:, None, :3, 2]
    raw = all_branches(robot, lines.reshape(-1, 4, 4), exact)
    shape = (*lines.shape[:2], len(BRANCH_NAMES))
    q = np.unwrap(raw.q.reshape(*shape, -1), axis=1)
    # shift by whole revolutions, so that the middle of the line is nearest to the middle of the limits
    least, most = q.min(axis=1), q.max(axis=1)
    middle = (least + most) / 2
    turns = nearest_turns(middle, (limits.lower + limits.upper) / 2) - middle
    q = q + turns[:, None]
    room = np.minimum(least + turns - limits.lower, limits.upper - most - turns)
    joint = room.argmin(axis=-1)
    margin = np.take_along_axis(room, joint[..., None], axis=-1)[..., 0]
    # unless solutions are checked, those that are near to the pose count as reached
    reached = raw.reached & (raw.outside < _NEAR)
    beyond = np.where(reached, 0.0, np.maximum(raw.outside, 1e-9)).reshape(shape)
    outside = beyond.max(axis=1)
    hurry = np.abs(np.diff(q, axis=1)).max(axis=1) / (limits.velocity * (heights[1] / slowest))
    fastest = hurry.argmax(axis=-1)
    racing = np.where(np.take_along_axis(hurry, fastest[..., None], axis=-1)[..., 0] > 1.0, fastest, -1)
    of_joint = np.take_along_axis(q, joint[:, None, :, None], axis=-1)[..., 0]
    rooms = np.minimum(of_joint - limits.lower[joint][:, None], limits.upper[joint][:, None] - of_joint)
    worst = np.where(outside > 0.0, beyond.argmax(axis=1), rooms.argmin(axis=1))
    return LineMargins(lines, q, margin, joint, outside, racing, worst)
