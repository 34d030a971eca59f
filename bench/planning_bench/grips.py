"""All ways to serve a station: every yaw and branch whose line is within limits, followed in closed form.

Shared by the bounds, the scenes' necessary conditions and the peers (so that goals are cheap for all of them).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.numerics.products import norm
from arm.robot.model import Robot
from arm.se3 import Array
from plan.kinematics.closed_form import all_branches
from plan.kinematics.ik import nearest_turns
from plan.scene import Station
from planning_bench.query import OFFSET

SAMPLES = 21  # of a line; every 5 mm
_JUMP = 0.5  # rad between samples: the line crosses a singularity


@dataclass(frozen=True)
class GripLine:
    """One way to serve a station.

    Attributes:
        yaw: index into the station's tool poses.
        q: (SAMPLES, 6) rad from the station to the offset point.
    """

    yaw: int
    q: Array

    @property
    def q_station(self) -> Array:
        return np.asarray(self.q[0])

    @property
    def q_offset(self) -> Array:
        return np.asarray(self.q[-1])


def line_poses(T_base_tool: Array, count: int = SAMPLES, offset: float = OFFSET) -> Array:
    """Tool poses (count, 4, 4) from a station back along the tool's axis."""
    T = np.tile(T_base_tool, (count, 1, 1))
    T[:, :3, 3] -= np.linspace(0.0, offset, count)[:, None] * T_base_tool[:3, 2]
    return T


def grip_lines(
    robot: Robot, station: Station, limits: Limits, count: int = SAMPLES, offset: float = OFFSET
) -> list[GripLine]:
    """Every yaw, branch and whole turn whose line stays within limits and runs smoothly."""
    yaws = len(station.T_base_tool)
    poses = np.concatenate([line_poses(T, count, offset) for T in station.T_base_tool])
    raw = all_branches(robot, poses)
    reached = raw.reached.reshape(yaws, count, -1).all(axis=1)
    q = raw.q.reshape(yaws, count, raw.q.shape[1], -1)
    found = []
    for yaw, branch in np.argwhere(reached):
        line = q[yaw, :, branch].copy()
        for i in range(1, count):
            line[i] = nearest_turns(line[i], line[i - 1])
        if np.abs(np.diff(line, axis=0)).max() > _JUMP * 20 / (count - 1):
            continue
        first = np.ceil((limits.lower - line.min(axis=0)) / (2 * np.pi) - 1e-12)
        last = np.floor((limits.upper - line.max(axis=0)) / (2 * np.pi) + 1e-12)
        if (first > last).any():
            continue
        for turns in np.ndindex(*(last - first + 1).astype(int)):
            found.append(GripLine(int(yaw), line + 2 * np.pi * (first + turns)))
    return found


def by_distance(lines: Sequence[GripLine], q: Array) -> list[GripLine]:
    """Lines whose offset point is nearest to q (Euclidean, as the seed has it) first."""
    return sorted(lines, key=lambda g: float(norm(g.q_offset - q)))
