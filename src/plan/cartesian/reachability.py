"""Reachability of holes: every yaw and every branch, over the whole approach line.

A candidate serves a hole if, from the hole to the offset point above it, the arm stays within limits and on one branch,
and no joint is too fast. If no candidate does, the table has the nearest miss and its reason.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from arm.arguments import finite, rigid
from arm.controller.unit import Limits
from arm.errors import ImpossibleError, InputError
from arm.former import former_names
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.cartesian.line import LineOptions, follow_line
from plan.cartesian.line_margins import LineMargins, heights_of, line_margins
from plan.kinematics.closed_form import BRANCH_NAMES, has_closed_form
from plan.kinematics.configuration import require_limits
from plan.kinematics.numeric_ik import solve_ik
from plan.options import PlanOptions
from plan.scene import Station

_MOST_SOLUTIONS = 12  # for each pose of an arm without a closed form


@dataclass(frozen=True)
class GraspCandidate:
    """One yaw and branch for a hole, and the result along its line.

    Attributes:
        hole: its name.
        yaw: index into the hole's poses.
        branch: see `plan.kinematics.ik.BRANCH_NAMES`; of an arm without a closed form, the number of the solution.
        q_line: (m, n) rad at even distances from the hole to the offset point, continuous.
        margin: smallest distance of a joint from its limits, rad; negative beyond a limit.
        joint: that joint.
        outside: largest distance of the line beyond the reach of the links, m; 0 within reach.
        racing: name of a joint that would exceed its velocity limit even at the slowest tool speed, or "".
        miss: why an arm without a closed form does not serve the hole so, or "".
        T_worst: pose 4x4 of the tool on the line where it misses most, or has least room.
    """

    hole: str
    yaw: int
    branch: str
    q_line: Array
    margin: float
    joint: str
    outside: float
    racing: str
    miss: str = ""
    T_worst: Array | None = None

    @property
    def q_hole(self) -> Array:
        """(6,) rad at the hole."""
        return np.asarray(self.q_line[0])

    @property
    def q_offset(self) -> Array:
        """(6,) rad at the offset point."""
        return np.asarray(self.q_line[-1])

    @property
    def ok(self) -> bool:
        """Whether this candidate serves the hole."""
        return self.margin >= 0.0 and self.outside == 0.0 and not self.racing and not self.miss

    def reason(self) -> str:
        """Return in words why the candidate fails, or its margin."""
        if self.miss:
            return self.miss
        if self.outside > 0.0:
            return f"the line leaves the workspace by {self.outside * 1e3:.1f} mm"
        if self.margin < 0.0:
            return f"joint {self.joint} goes {np.degrees(-self.margin):.1f} deg beyond its limit"
        if self.racing:
            return f"joint {self.racing} cannot move fast enough near a singular configuration"
        return f"joint {self.joint} stays {np.degrees(self.margin):.1f} deg from its limit"

    def shortfall(self) -> dict[str, Any]:
        """Return what the candidate misses: outside_mm; or joint and excess_deg; or racing; or miss."""
        if self.miss:
            return {"miss": self.miss}
        if self.outside > 0.0:
            return {"outside_mm": self.outside * 1e3}
        if self.margin < 0.0:
            return {"joint": self.joint, "excess_deg": float(np.degrees(-self.margin))}
        return {"racing": self.racing}


@dataclass(frozen=True)
class HoleReach:
    """All candidates for one hole: those that serve it, by decreasing margin, then the nearest misses."""

    hole: str
    choices: tuple[GraspCandidate, ...]

    @property
    def ok(self) -> bool:
        """Whether some candidate serves the hole."""
        return self.choices[0].ok

    @property
    def best(self) -> GraspCandidate:
        """The candidate with the largest margin, or the nearest miss."""
        return self.choices[0]

    def feasible(self) -> tuple[GraspCandidate, ...]:
        """Return the candidates that serve the hole, by decreasing margin."""
        return tuple(c for c in self.choices if c.ok)


@dataclass(frozen=True)
class ReachTable:
    """Reachability of every hole, in the given order."""

    holes: tuple[HoleReach, ...]

    @property
    def ok(self) -> bool:
        """Whether every hole can be served."""
        return all(hole.ok for hole in self.holes)

    def __getitem__(self, name: str) -> HoleReach:
        for hole in self.holes:
            if hole.hole == name:
                return hole
        why = f"hole = {name!r}: must be one of {', '.join(h.hole for h in self.holes)}"
        raise InputError(why, hole=name)

    def require(self) -> None:
        """Require that every hole can be served.

        Raises:
            ImpossibleError: names every hole that cannot, its best branch and what stops it; data: holes, a list of
                hole, branch, yaw, and joint with excess_deg, or outside_mm, or racing.
        """
        failing = [hole.best for hole in self.holes if not hole.ok]
        if failing:
            reasons = "; ".join(f"hole {c.hole}: best branch {c.branch}, {c.reason()}" for c in failing)
            holes = [{"hole": c.hole, "branch": c.branch, "yaw": c.yaw, **c.shortfall()} for c in failing]
            raise ImpossibleError(f"out of reach: {reasons}", holes=holes)


def reach(
    robot: Robot,
    limits: Limits,
    grasps: Mapping[str, Sequence[Array]],
    offset_m: float,
    slowest: float = LineOptions.slowest,
) -> ReachTable:
    """Try all yaws and branches of every hole along its line.

    Args:
        robot: the arm.
        limits: limits of position, and of velocity for joints near a singularity.
        grasps: hole name to T_base_tool (4, 4) at the hole, one per yaw.
        offset_m: length of the line, which runs from the hole along the tool's -z, m.
        slowest: tool speed that the joints must allow, m/s.

    Raises:
        InputError: no holes, a hole without poses or with one that is not rigid, or an offset that is not positive.
    """
    if not grasps or not all(len(poses) for poses in grasps.values()):
        why = "grasps: must have one or more holes, each with one or more poses"
        raise InputError(why, holes=list(grasps))
    finite("offset", offset_m, "m")
    if not offset_m > 0.0:
        raise InputError(f"offset = {offset_m:g} m: must be positive", offset_m=offset_m)
    heights = heights_of(offset_m)
    require_limits(robot, limits)
    poses = np.stack(
        [rigid(f"hole {name!r}: pose {i}", T) for name, hole in grasps.items() for i, T in enumerate(hole)]
    )
    if not has_closed_form(robot):
        return _numeric_reach(robot, limits, grasps, heights, slowest)
    margins = line_margins(robot, limits, poses, heights, slowest)
    holes, row = [], 0
    for name, yaws in grasps.items():
        each = product(range(len(yaws)), range(len(BRANCH_NAMES)))
        choices = [_candidate(robot, margins, name, row + yaw, yaw, branch) for yaw, branch in each]
        holes.append(HoleReach(name, tuple(sorted(choices, key=_rank))))
        row += len(yaws)
    return ReachTable(tuple(holes))


def reach_stations(
    robot: Robot, planned: Limits, stations: Iterable[Station], options: PlanOptions
) -> ReachTable:
    """Return the `reach` of stations under the limits and options of motion planning."""
    grasps = {station.name: station.T_base_tool for station in stations}
    return reach(robot, planned, grasps, options.offset, options.slowest)


def _rank(choice: GraspCandidate) -> tuple[float, ...]:
    """Return a sort key: candidates that serve, by decreasing margin; misses within reach; others, by distance."""
    branch = BRANCH_NAMES.index(choice.branch) if choice.branch in BRANCH_NAMES else 0
    return float(not choice.ok), choice.outside, -choice.margin, float(choice.yaw), float(branch)


def _numeric_reach(
    robot: Robot, limits: Limits, grasps: Mapping[str, Sequence[Array]], heights: Array, slowest: float
) -> ReachTable:
    """Return the reach of an arm without a closed form: solutions at the holes, followed along the lines."""
    options = LineOptions(slowest=slowest)
    holes = []
    for name, yaws in grasps.items():
        choices: list[GraspCandidate] = []
        for yaw, T in enumerate(yaws):
            found = solve_ik(robot, T, limits.lower, limits.upper)
            for number, q in enumerate(_spread(found.q, limits, _MOST_SOLUTIONS)):
                end = np.array(T)
                end[:3, 3] -= heights[-1] * end[:3, 2]
                try:
                    path = follow_line(robot, q, T, end, limits, options)
                except ImpossibleError as error:
                    choices.append(_missed(robot, name, yaw, f"{number:02d}", str(error), end))
                    continue
                q_line = path.spline(heights)
                room = np.minimum(q_line - limits.lower, limits.upper - q_line).min(axis=0)
                joint = int(np.argmin(room))
                # the line was followed within limits
                nearest = float(max(room[joint], 0.0)), robot.joint_names[joint]
                choices.append(GraspCandidate(name, yaw, f"{number:02d}", frozen(q_line), *nearest, 0.0, ""))
        if not choices:
            choices.append(_missed(robot, name, 0, "none", "no solution of the pose was found", yaws[0]))
        holes.append(HoleReach(name, tuple(sorted(choices, key=_rank))))
    return ReachTable(tuple(holes))


def _missed(robot: Robot, hole: str, yaw: int, branch: str, why: str, T: Array) -> GraspCandidate:
    nowhere = frozen(np.zeros((2, len(robot.joint_names))))
    return GraspCandidate(hole, yaw, branch, nowhere, -np.inf, robot.joint_names[0], 0.0, "", why, T)


def _spread(q: Array, limits: Limits, most: int) -> Array:
    """Return at most so many of the solutions (k, n): the one with the most room, then each the furthest from those."""
    if len(q) <= most:
        return q
    room = np.minimum(q - limits.lower, limits.upper - q).min(axis=1)
    chosen = [int(np.argmax(np.round(room, 9)))]
    away = np.full(len(q), np.inf)
    while len(chosen) < most:
        away = np.minimum(away, np.abs(q - q[chosen[-1]]).max(axis=1))
        chosen.append(int(np.argmax(np.round(away, 9))))
    return q[chosen]


def _candidate(
    robot: Robot, margins: LineMargins, hole: str, line: int, yaw: int, branch: int
) -> GraspCandidate:
    racing = int(margins.racing[line, branch])
    return GraspCandidate(
        hole=hole,
        yaw=yaw,
        branch=BRANCH_NAMES[branch],
        q_line=frozen(margins.q[line, :, branch]),
        margin=float(margins.margin[line, branch]),
        joint=robot.joint_names[int(margins.joint[line, branch])],
        outside=float(margins.outside[line, branch]),
        racing=robot.joint_names[racing] if racing >= 0 else "",
        T_worst=margins.lines[line, margins.worst[line, branch]],
    )


former_names(__name__, __name__, LineChoice="GraspCandidate")
