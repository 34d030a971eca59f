"""Straight lines of the tool, followed by differential inverse kinematics as a quadratic program.

At each way-point of the line, from the configuration q of the one before, steps dq are taken that solve

    minimise   |J dq - e|^2 + small |dq|^2        e: twist from the tool to the way-point, tool axes
    subject to lower <= q + dq <= upper           joint limits
               |dq since the last way-point| <= velocity * (time at the slowest speed that is allowed)
               G dq <= h                          what the caller adds, such as collision barriers

until e vanishes (S. Caron's "Inverse kinematics" notes and pink use the same form). A way-point that cannot be met is
an error that names the constraint which holds it back; a shorter line is never returned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import qpsolvers
import scipy.sparse

from arm.errors import ImpossibleError, InputError
from arm.robot import Robot
from arm.se3 import Array, frozen, rotation, rotation_vector
from arm.unit import Limits

SOLVERS = ("daqp", "osqp")
_ROTATION_SCALE = 0.2  # m per rad: weighs the tool's rotation against its translation
_DAMPING = 1e-10
_CONVERGED = 1e-10  # m and rad
_MAX_STEPS = 20
_BARRIER_SLACK = 1e-9  # of a barrier's h at a way-point
_ACTIVE = 1e-7  # rad from a bound that counts as lying on it
# daqp is exact up to its tolerance on bounds; osqp needs tight ones to be any use here
_SETTINGS: dict[str, dict[str, float | int]] = {
    "daqp": {"primal_tol": 1e-9},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000, "raise_error": False},
}


@dataclass(frozen=True)
class Line:
    """A straight line of the tool: translation in proportion, rotation at a constant rate about a fixed axis.

    Attributes:
        T_start, T_end: (4, 4) in the base frame.
    """

    T_start: Array
    T_end: Array

    @property
    def length(self) -> float:
        """m."""
        return float(np.linalg.norm(self.T_end[:3, 3] - self.T_start[:3, 3]))

    def poses(self, fraction: Array) -> Array:
        """Poses (m, 4, 4) at fractions (m,) of the way."""
        turn = rotation_vector(self.T_start[:3, :3].T @ self.T_end[:3, :3])
        T = np.tile(np.eye(4), (len(fraction), 1, 1))
        T[:, :3, 3] = self.T_start[:3, 3] + fraction[:, None] * (self.T_end[:3, 3] - self.T_start[:3, 3])
        T[:, :3, :3] = self.T_start[:3, :3]
        if np.linalg.norm(turn) > 0.0:
            T[:, :3, :3] = np.stack([self.T_start[:3, :3] @ rotation(f * turn) for f in fraction])
        return T

    def deviation(self, T_base_tool: Array) -> LineDeviation:
        """How far poses (m, 4, 4) are off the line, wherever along it they are."""
        along = self.T_end[:3, 3] - self.T_start[:3, 3]
        offset = T_base_tool[:, :3, 3] - self.T_start[:3, 3]
        fraction = np.clip(offset @ along / max(float(along @ along), 1e-18), 0.0, 1.0)
        wanted = self.poses(fraction)
        lateral = np.linalg.norm(T_base_tool[:, :3, 3] - wanted[:, :3, 3], axis=-1)
        # |R_a - R_b| (Frobenius) = 2 sqrt(2) sin(angle / 2), which keeps its digits at small angles
        chord = np.linalg.norm(T_base_tool[:, :3, :3] - wanted[:, :3, :3], axis=(-2, -1))
        return LineDeviation(lateral, 2 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0)))


@dataclass(frozen=True)
class LineDeviation:
    """Distance from a line (m,) in m, and from its orientation (m,) in rad."""

    distance: Array
    angle: Array


@dataclass(frozen=True)
class Barrier:
    """Rows G dq <= h that a step must keep, with a name each for messages; (k, n), (k,).

    h is what is left of each constraint at q: at no way-point may it be negative.
    """

    G: Array
    h: Array
    names: tuple[str, ...]


_NO_BARRIER = Barrier(np.zeros((0, 0)), np.zeros(0), ())


@dataclass(frozen=True)
class LineOptions:
    """How a line is followed.

    Attributes:
        step: distance of way-points at most, m; `step_angle` the same for rotation, rad.
        tolerance, angle_tolerance: of every way-point, m and rad.
        slowest: the tool may have to go as slowly as this for the joints to keep up, m/s; slower is refused.
        solver: one of `SOLVERS`.
        barrier: called with q (n,), gives further rows; or None.
    """

    step: float = 0.002
    step_angle: float = 0.02
    tolerance: float = 1e-5
    angle_tolerance: float = 8.7e-5
    slowest: float = 0.002
    solver: str = "daqp"
    barrier: Callable[[Array], Barrier] | None = field(default=None, compare=False)


@dataclass(frozen=True)
class JointPath:
    """Configurations along a path; between them it is the cubic spline through them (`plan.paths.smooth_path`).

    Attributes:
        q: (n, 6) rad.
        s: (n,) strictly increasing from 0; m of tool travel for a line.
    """

    q: Array
    s: Array


def follow_line(
    robot: Robot,
    q_start: npt.ArrayLike,
    T_start: Array,
    T_end: Array,
    limits: Limits,
    options: LineOptions | None = None,
) -> JointPath:
    """Joint path that moves the tool straight from `T_start` to `T_end`, starting at `q_start`.

    Args:
        robot: the arm.
        q_start: (n,) rad, with the tool at `T_start`.
        T_start, T_end: (4, 4) in the base frame.
        limits: of position and velocity.
        options: see `LineOptions`.

    Returns:
        way-points within the options' tolerances of the line, the first being `q_start` itself, the last at `T_end`;
        s in metres (of tool travel; for a pure rotation in rad).

    Raises:
        InputError: `q_start` is not at `T_start`, is outside limits, or the solver is not known.
        ImpossibleError: a limit or barrier stops the line; data: constraint, joint, done_m, length_m (as s).
    """
    options = options or LineOptions()
    if options.solver not in SOLVERS:
        raise InputError(
            f"solver = {options.solver!r}: must be one of {', '.join(SOLVERS)}", solver=options.solver
        )
    line = Line(frozen(T_start), frozen(T_end))
    q = np.array(q_start, dtype=float)
    _check_start(robot, q, line, limits, options)
    angle = float(np.linalg.norm(rotation_vector(line.T_start[:3, :3].T @ line.T_end[:3, :3])))
    # without travel the turn is what is measured along the path
    length = line.length if line.length > options.tolerance else angle
    if length == 0.0:
        raise InputError("a line needs two different poses", length_m=0.0)
    count = max(4, int(np.ceil(max(line.length / options.step, angle / options.step_angle) - 1e-9)))
    s = np.linspace(0.0, length, count + 1)
    follower = _Follower(robot, limits, options, limits.velocity * (s[1] / options.slowest), line, length)

    path = [q]
    for done, goal in zip(s[:-1], line.poses(s[1:] / length), strict=True):
        # the line goes on much as before: begin the search there, the bounds keep it honest
        guess = q if len(path) == 1 else 2 * q - path[-2]
        q = follower.meet(goal, q, guess, float(done))
        path.append(q)
    return JointPath(frozen(path), frozen(s))


def _check_start(robot: Robot, q: Array, line: Line, limits: Limits, options: LineOptions) -> None:
    off = np.abs(_twist(robot, q, line.T_start))
    if off[:3].max() > options.tolerance or off[3:].max() > options.angle_tolerance:
        raise InputError(
            f"the line starts {np.linalg.norm(off[:3]) * 1e3:.3g} mm and {np.degrees(np.linalg.norm(off[3:])):.3g} deg "
            f"from where q_start puts the tool (at most {options.tolerance * 1e3:g} mm)",
            distance_m=float(np.linalg.norm(off[:3])),
        )
    excess = np.maximum(limits.lower - q, q - limits.upper)
    if excess.max() > _ACTIVE:
        joint = int(np.argmax(excess))
        raise InputError(
            f"q_start has joint {robot.joint_names[joint]} {np.degrees(excess[joint]):.3g} deg beyond its limits",
            joint=robot.joint_names[joint],
            excess_rad=float(excess[joint]),
        )


def _twist(robot: Robot, q: Array, goal: Array) -> Array:
    """From the tool at q to the goal: metres and rad in the tool's axes (6,), exact to first order."""
    T = robot.T_base_tool(q)
    R = T[:3, :3]
    return np.concatenate([R.T @ (goal[:3, 3] - T[:3, 3]), rotation_vector(R.T @ goal[:3, :3])])


_WEIGHT = np.array([1.0, 1.0, 1.0, _ROTATION_SCALE, _ROTATION_SCALE, _ROTATION_SCALE])


@dataclass(frozen=True, eq=False)
class _Follower:
    """Meets one way-point after the other. `reach`: how far a joint may turn from one to the next, rad."""

    robot: Robot
    limits: Limits
    options: LineOptions
    reach: Array
    line: Line
    length: float

    def meet(self, goal: Array, before: Array, guess: Array, done: float) -> Array:
        """The configuration near `guess` with the tool at `goal`, inside all constraints."""
        lower = np.maximum(self.limits.lower, before - self.reach)
        upper = np.minimum(self.limits.upper, before + self.reach)
        q = np.clip(guess, lower, upper)
        solution: qpsolvers.Solution | None = None
        for _ in range(_MAX_STEPS):
            twist = _twist(self.robot, q, goal)
            barrier = self.options.barrier(q) if self.options.barrier else _NO_BARRIER
            kept = barrier.h.min(initial=0.0) >= -_BARRIER_SLACK
            if np.abs(twist).max() <= _CONVERGED and kept:
                return q
            J = _WEIGHT[:, None] * self.robot.jacobian(q)
            solution = _solve(J, _WEIGHT * twist, lower - q, upper - q, barrier, self.options.solver)
            if not solution.found or solution.x is None:
                break
            moved = np.clip(q + solution.x, lower, upper)
            settled = np.abs(moved - q).max() < 1e-13
            q = moved
            if settled:
                break
        twist = _twist(self.robot, q, goal)
        if self.options.barrier:
            kept = self.options.barrier(q).h.min(initial=0.0) >= -_BARRIER_SLACK
        near = np.linalg.norm(twist[:3]) <= self.options.tolerance
        near &= np.linalg.norm(twist[3:]) <= self.options.angle_tolerance
        if near and kept:
            return q
        raise self.stopped(before, q, solution, barrier, done)

    def stopped(
        self, before: Array, q: Array, solution: qpsolvers.Solution | None, barrier: Barrier, done: float
    ) -> ImpossibleError:
        """The error that says which constraint stopped the line, by its multiplier where several do."""
        found = solution is not None and solution.found
        pull = np.zeros(len(q))
        rows = np.zeros(0)
        if solution is not None and found:
            pull = np.abs(solution.z_box) if solution.z_box is not None else pull
            rows = solution.z if solution.z is not None and len(barrier.h) else rows
        limits = self.limits
        on_limit = (q - limits.lower < _ACTIVE) | (limits.upper - q < _ACTIVE)
        too_fast = self.reach - np.abs(q - before) < _ACTIVE
        blocking = np.where(on_limit | too_fast, pull + 1e-12, 0.0)
        joint = int(np.argmax(blocking))
        name: str | None = self.robot.joint_names[joint]
        if not found:
            constraint, name = "barrier", None
            text = f"no step keeps all of {', '.join(barrier.names) or 'the joint limits'}"
        elif rows.max(initial=0.0) > blocking[joint]:
            constraint, name = barrier.names[int(np.argmax(rows))], None
            text = f"{constraint} is in the way"
        elif blocking[joint] == 0.0:
            constraint, name = "workspace", None
            text = "the pose is out of the arm's reach or singular there"
        elif on_limit[joint]:
            at_lower = q[joint] - limits.lower[joint] < _ACTIVE
            side, value = ("lower", limits.lower[joint]) if at_lower else ("upper", limits.upper[joint])
            constraint = f"{name} {side} limit"
            text = f"joint {name} is at its {side} limit of {np.degrees(value):.2f} deg"
        else:
            constraint = f"{name} speed"
            text = (
                f"joint {name} cannot turn fast enough ({np.degrees(limits.velocity[joint]):.3g} deg/s) even at "
                f"{self.options.slowest * 1e3:g} mm/s; the arm passes close to a singular configuration"
            )
        shown = f"{done * 1e3:.1f} of {self.length * 1e3:.1f} mm"
        if self.line.length <= self.options.tolerance:
            shown = f"{np.degrees(done):.2f} of {np.degrees(self.length):.2f} deg"
        return ImpossibleError(
            f"line stops after {shown}: {text}; another branch or yaw may do, or another place of the board",
            constraint=constraint,
            joint=name,
            done_m=done,
            length_m=self.length,
        )


def _solve(
    J: Array, e: Array, lower: Array, upper: Array, barrier: Barrier, solver: str
) -> qpsolvers.Solution:
    P = J.T @ J + _DAMPING * np.eye(J.shape[1])
    G, h = (barrier.G, barrier.h) if len(barrier.h) else (None, None)
    if solver == "osqp":
        P, G = scipy.sparse.csc_matrix(P), None if G is None else scipy.sparse.csc_matrix(G)
    problem = qpsolvers.Problem(P, -J.T @ e, G=G, h=h, lb=lower, ub=upper)
    return qpsolvers.solve_problem(problem, solver=solver, **_SETTINGS[solver])
