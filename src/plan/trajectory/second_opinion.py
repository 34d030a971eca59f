"""A second opinion on the time of a motion: the library toppra times it again, on a spline through what is sent.

The path is a cubic spline through the sent motion, over the nominal time in which the fastest joint is at its velocity
limit. Where the motion rests, it is timed part by part. On lines, the tool is not faster than the sent one at its
fastest there, because a plan file does not state the caps that the lines were planned with.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from arm.controller.segments import CountPath
from arm.controller.unit import Limits, Unit
from arm.plan_file import Motion, Move
from arm.robot.model import Robot
from arm.se3 import Array
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.trajectory.timing import time_curve

_LINES = ("approach", "retract", "line")
_SAMPLE = 0.01  # s, between samples of the sent motion
_APART = 0.03  # s of nominal time between knots of the spline, or
_KNOTS = 1000  # so many of them on a short path
_RESTS = 1e-3  # of the velocity limit
_STILL = 1e-9  # rad


def time_again(motion: Motion, robot: Robot, unit: Unit, limits: Limits) -> float:
    """Return the duration in s that toppra gives a spline through a sent motion.

    Args:
        motion: as it is sent.
        robot: the arm, for the tool on lines.
        unit: whose counts.
        limits: that the motion was planned with.

    Raises:
        ImpossibleError: toppra gives no answer.
    """
    path = motion.path
    ends = np.cumsum([move.path.duration_s for move in motion.moves])
    caps = np.array([_tool_speed(m, robot, unit) if _is_line(m) else np.inf for m in motion.moves])
    total = 0.0
    for begin, end in pairwise(_rests(path, unit, limits)):
        times = np.linspace(begin, end, max(8, int((end - begin) / _SAMPLE)) + 1)
        q = unit.positions(path.at(times))
        if np.ptp(q, axis=0).max() < _STILL:
            total += end - begin  # it dwells
            continue
        s = np.concatenate([[0.0], np.cumsum((np.abs(np.diff(q, axis=0)) / limits.velocity).max(axis=1))])
        knots = _apart(s, min(_APART, s[-1] / _KNOTS))
        tool = product_of_exponentials(robot).tool_poses(q[knots])[:, :3, 3]
        travel = np.linalg.norm(np.diff(tool, axis=0), axis=1) / np.diff(s[knots])
        which = np.searchsorted(ends[:-1], times[knots][1:] - 1e-9)
        rates = caps[which] / np.maximum(travel, 1e-12)
        total += time_curve(CubicSpline(s[knots], q[knots]), limits, rates, by_toppra=True).duration
    return total


def _is_line(move: Move) -> bool:
    """Whether a move follows a line; in the plan of a list only its name says so."""
    return move.role in _LINES or move.name.split(" ")[0] in _LINES


def _tool_speed(move: Move, robot: Robot, unit: Unit) -> float:
    """Return the largest speed of the tool on a move, m/s."""
    times = np.linspace(0.0, move.path.duration_s, max(8, int(move.path.duration_s / _SAMPLE)) + 1)
    tool = product_of_exponentials(robot).tool_poses(unit.positions(move.path.at(times)))[:, :3, 3]
    return float((np.linalg.norm(np.diff(tool, axis=0), axis=1) / np.diff(times)).max())


def _rests(path: CountPath, unit: Unit, limits: Limits) -> list[float]:
    """Return the times at which the motion is at rest, both ends among them, s."""
    a1, a2, a3 = path.cubics()
    ends = path.knot_times()[1:]
    most = np.abs(unit.counts_per_rad) * limits.velocity * np.diff(path.knot_times())[:, None]
    arrives, leaves = np.abs(a1 + 2.0 * a2 + 3.0 * a3) / most, np.abs(a1) / most
    still = np.maximum(arrives[:-1], leaves[1:]).max(axis=1) < _RESTS
    return [0.0, *ends[:-1][still].tolist(), float(ends[-1])]


def _apart(s: Array, least: float) -> list[int]:
    """Return indices of values at least this far apart, and of both ends."""
    knots = [0]
    for i in range(1, len(s) - 1):
        if s[i] - s[knots[-1]] >= least and s[-1] - s[i] >= least:
            knots.append(i)
    return [*knots, len(s) - 1]
