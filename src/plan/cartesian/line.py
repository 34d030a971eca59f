"""Straight lines of the tool as joint paths: a cubic spline through way-points by `plan.cartesian.differential_ik`.

The spline is compared with the line, and the step is halved until it is within the tolerances everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from arm.controller.unit import Limits
from arm.errors import ImpossibleError, InputError
from arm.numerics.products import norm
from arm.robot.model import Robot
from arm.se3 import Array, frozen
from plan.budget import LINE_CHECKS, spend
from plan.cartesian.differential_ik import ACTIVE, Barrier, Follower, LineOptions
from plan.kinematics.product_of_exponentials import product_of_exponentials
from plan.kinematics.straight_line import TURNS, Line, LineDeviation
from plan.options import SOLVERS

__all__ = ["SOLVERS", "Barrier", "JointPath", "Line", "LineDeviation", "LineOptions", "follow_line"]

_MAX_HALVINGS = 5  # of the step


@dataclass(frozen=True)
class JointPath:
    """Configurations along a path, connected by a cubic spline.

    Attributes:
        q: (m, n) rad.
        s: (m,) strictly increasing from 0; m of tool travel for a line.
    """

    q: Array
    s: Array

    @cached_property
    def spline(self) -> CubicSpline:
        """The cubic spline through q over s."""
        return CubicSpline(self.s, self.q)


def follow_line(
    robot: Robot,
    q_start: npt.ArrayLike,
    T_start: Array,
    T_end: Array,
    limits: Limits,
    options: LineOptions | None = None,
) -> JointPath:
    """Return the joint path that moves the tool straight from `T_start` to `T_end`, starting at `q_start`.

    Args:
        robot: the arm.
        q_start: (n,) rad, with the tool at `T_start`.
        T_start, T_end: (4, 4) in the base frame.
        limits: limits of position and velocity.
        options: see `LineOptions`.

    Returns:
        Way-points from `q_start` to a configuration at `T_end`. They and the spline through them are within the
        tolerances of the line, and barriers hold at the way-points. s is the tool travel in m, or in rad for a pure
        rotation.

    Raises:
        InputError: `q_start` is not at `T_start` or beyond limits, or the solver or axis is not known.
        ImpossibleError: a limit or barrier stops the line; data: constraint, joint, distance_m (of a barrier's
            bodies), done_m, length_m (as s).
    """
    spend(LINE_CHECKS)
    options = options or LineOptions()
    for name, value, known in (
        ("solver", options.solver, SOLVERS),
        ("free_axis", options.free_axis, TURNS),
    ):
        if value not in known:
            choices = ", ".join(str(k) for k in known)
            raise InputError(f"{name} = {value!r}: must be one of {choices}", **{name: value})
    line = Line(frozen(T_start), frozen(T_end))
    q = np.array(q_start, dtype=float)
    _check_start(robot, q, line, limits, options)
    angle = float(norm(line.turn))
    # s is the angle if the tool does not travel
    length = line.length if line.length > options.tolerance else angle
    if length == 0.0:
        raise InputError("a line needs two different poses", length_m=0.0)
    count = max(4, int(np.ceil(max(line.length / options.step, angle / options.step_angle) - 1e-9)))
    for _ in range(_MAX_HALVINGS):
        path = _followed(robot, q, line, limits, options, np.linspace(0.0, length, count + 1))
        off, beyond = _between(robot, path, line, limits, options.free_axis)
        kept = off.distance.max() <= options.tolerance and off.angle.max() <= options.angle_tolerance
        if kept and beyond <= ACTIVE:
            return path
        count *= 2
    worst = int(np.argmax(off.distance / options.tolerance + off.angle / options.angle_tolerance))
    done = float(path.s[worst // len(_BETWEEN)])
    why = (
        f"line cannot be kept after {done * 1e3:.1f} of {length * 1e3:.1f} mm: between way-points "
        f"{path.s[1] * 1e3:.2g} mm apart the tool is {off.distance[worst] * 1e6:.1f} um and "
        f"{np.degrees(off.angle[worst]):.2g} deg off; the arm is close to a singular configuration there, or a "
        "barrier or a joint limit bends the path sharply; try another configuration or another rotation of the tool"
    )
    raise ImpossibleError(why, constraint="smoothness", joint=None, done_m=done, length_m=length)


_BETWEEN = np.array([0.25, 0.5, 0.75])  # places between way-points where the spline is compared with the line


def _between(
    robot: Robot, path: JointPath, line: Line, limits: Limits, free_axis: str | None
) -> tuple[LineDeviation, float]:
    """Return the deviation of the spline from the line between way-points, and how far it leaves joint limits, rad."""
    places = (path.s[:-1, None] + np.diff(path.s)[:, None] * _BETWEEN).ravel()
    q = path.spline(places)
    poses = product_of_exponentials(robot).tool_poses(q)
    on_the_spot = line.length < 0.5 * path.s[-1]
    beyond = float(np.maximum(limits.lower - q, q - limits.upper).max())
    return line.deviation(poses, free_axis, places / path.s[-1] if on_the_spot else None), beyond


def _followed(
    robot: Robot, q: Array, line: Line, limits: Limits, options: LineOptions, s: Array
) -> JointPath:
    length = float(s[-1])
    inner = replace(
        limits,
        lower=frozen(np.minimum(limits.lower + options.room, np.maximum(limits.lower, q))),
        upper=frozen(np.maximum(limits.upper - options.room, np.minimum(limits.upper, q))),
    )
    follower = Follower(robot, inner, options, limits.velocity * (s[1] / options.slowest), line, length)
    path = [q]
    for i, (done, goal) in enumerate(zip(s[:-1], line.poses(s[1:] / length), strict=True)):
        # start the search from an extrapolation of the path. With a free direction start from the last way-point,
        # because extrapolation would continue a motion along it
        if options.way is not None:
            guess = options.way(float(s[i + 1]) / length)
        else:
            guess = path[-1] if options.free_axis or options.barrier else _extrapolated(path)
        path.append(follower.meet(goal, path[-1], guess, float(done)))
    return JointPath(frozen(path), frozen(s))


def _extrapolated(path: list[Array]) -> Array:
    """Extrapolate the polynomial through the last four way-points by one step."""
    match path[-4:]:
        case [a, b, c, d]:
            return np.asarray(4.0 * (d + b) - 6.0 * c - a)
        case [a, b, c]:
            return np.asarray(3.0 * (c - b) + a)
        case [a, b]:
            return np.asarray(2.0 * b - a)
        case _:
            return path[-1]


def _check_start(robot: Robot, q: Array, line: Line, limits: Limits, options: LineOptions) -> None:
    T = robot.T_base_tool(q)
    distance = float(norm(T[:3, 3] - line.T_start[:3, 3]))
    angle = float(Line(line.T_start, line.T_start).deviation(T[None], options.free_axis).angle[0])
    if distance > options.tolerance or angle > options.angle_tolerance:
        raise InputError(
            f"the line starts {distance * 1e3:.3g} mm and {np.degrees(angle):.3g} deg "
            f"from the tool at q_start (at most {options.tolerance * 1e3:g} mm)",
            distance_m=distance,
        )
    excess = np.maximum(limits.lower - q, q - limits.upper)
    if excess.max() > ACTIVE:
        joint = int(np.argmax(excess))
        why = f"q_start has joint {robot.joint_names[joint]} {np.degrees(excess[joint]):.3g} deg beyond its limits"
        raise InputError(why, joint=robot.joint_names[joint], excess_rad=float(excess[joint]))
