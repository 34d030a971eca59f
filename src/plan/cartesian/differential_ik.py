"""Way-points of a line by differential inverse kinematics as a quadratic program (QP).

For each way-point of the line, steps dq from a nearby configuration q solve

    minimise   |J dq - e|^2 + small |dq|^2        e: twist from the tool to the way-point, tool axes
    subject to lower <= q + dq <= upper           joint limits
               |dq since the last way-point| <= velocity * (time at the slowest allowed tool speed)
               G dq <= h                          barriers of the caller, such as
               `plan.cartesian.collision_barrier.collision_barrier`

until e vanishes (S. Caron's "Inverse kinematics" notes and pink use the same form). If the unconstrained minimum
satisfies all constraints, it is the step, and no solver runs. A way-point that cannot be reached is an error that names
the constraint which prevents it; the result is never a shorter line.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np
import qpsolvers
import scipy.sparse

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.numerics.products import mul, solve_positive
from arm.robot.model import Robot
from arm.se3 import Array, rotation_vector
from plan.budget import STEP_CHECKS, spend
from plan.kinematics.straight_line import AXES, Line

ACTIVE = 1e-7  # rad, distance to a bound that counts as active
_ROTATION_SCALE = 0.2  # m per rad: weighs the tool's rotation against its translation
_DAMPING = 1e-10
_FREE_DAMPING = 1e-6  # where joints may move without the tool: keeps the quadratic program well conditioned
_CONVERGED = 1e-10  # m and rad
_MAX_STEPS = 40
_TRUST = 0.1  # rad (m for a prismatic joint), largest step with barriers
_BARRIER_SLACK = 1e-9  # m, by which a way-point may violate a barrier
_BARRIER_AIM = 1e-7  # m, margin of a step to a barrier, because barriers are curved
# daqp is exact up to its tolerance on bounds; osqp needs tight tolerances
_SETTINGS: dict[str, dict[str, float | int]] = {
    "daqp": {"primal_tol": 1e-9},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000, "raise_error": False},
}


@dataclass(frozen=True)
class Barrier:
    """Constraints G dq <= h of a step, (k, n) and (k,), with names for messages.

    h is the margin of each constraint at q; at a way-point it is not negative. `distance` (k,) m, or None, is the
    distance of each row's bodies, for messages.
    """

    G: Array
    h: Array
    names: tuple[str, ...]
    distance: Array | None = None

    def label(self, row: int) -> str:
        """Return the name of a row, with its distance."""
        if self.distance is None:
            return self.names[row]
        return f"{self.names[row]} ({self.distance[row] * 1e3:.2f} mm apart)"


_NO_BARRIER = Barrier(np.zeros((0, 0)), np.zeros(0), ())


@dataclass(frozen=True)
class LineOptions:
    """Options for following a line.

    Attributes:
        step, step_angle: largest distance between way-points, m and rad; halved until the spline through them is within
            the tolerances.
        tolerance, angle_tolerance: of the tool, at way-points and between them, m and rad.
        slowest: tool speed that the joints must allow everywhere on the line, m/s.
        solver: one of `plan.options.SOLVERS`.
        barrier: called with q (n,); returns additional constraints; or None.
        free_axis: what may turn freely, one of `TURNS`: an axis of the tool, or several of them such as ``xyz``; or
            None. The tool turns as little as possible.
        room: which way-points keep from joint limits as far as the start does, for what lies between them; rad (m).
        way: configuration (n,) near which way-points are searched, as a function of the fraction of the line; or None:
            near the way-point before.
    """

    step: float = 0.005
    step_angle: float = 0.05
    tolerance: float = 1e-5
    angle_tolerance: float = 8.7e-5
    slowest: float = 0.002
    solver: str = "daqp"
    barrier: Callable[[Array], Barrier] | None = field(default=None, compare=False)
    free_axis: str | None = None
    room: float = 0.0
    way: Callable[[float], Array] | None = field(default=None, compare=False)


def _twist(T: Array, goal: Array, free_axis: str | None) -> Array:
    """Return the twist (6,) from the tool at T to the goal, m and rad in tool axes, exact to first order.

    With a free axis, the rotation about it is 0 and the other two align it with the goal's. With two, the third is the
    part of the rotation vector about its axis (as in `plan.kinematics.numeric_ik`); with three, none is left.
    """
    R = T[:3, :3]
    apart = mul(R.T, goal[:3])
    twist = np.empty(6)
    twist[:3] = apart[:, 3] - mul(R.T, T[:3, 3])
    if free_axis is not None and len(free_axis) > 1:
        twist[3:] = np.where([name in free_axis for name in AXES], 0.0, rotation_vector(apart[:, :3]))
    elif free_axis is not None:
        axis = AXES.index(free_axis)
        twist[3:] = np.cross(np.eye(3)[axis], apart[:, axis])
    elif apart[0, 0] + apart[1, 1] + apart[2, 2] > 2.98:  # below 0.15 rad the sine approximates the angle
        twist[3] = 0.5 * (apart[2, 1] - apart[1, 2])
        twist[4] = 0.5 * (apart[0, 2] - apart[2, 0])
        twist[5] = 0.5 * (apart[1, 0] - apart[0, 1])
    else:
        twist[3:] = rotation_vector(apart[:, :3])
    return twist


_WEIGHT = np.array([1.0, 1.0, 1.0, _ROTATION_SCALE, _ROTATION_SCALE, _ROTATION_SCALE])


@dataclass(frozen=True, eq=False)
class Follower:
    """Finds the configurations at successive way-points.

    Attributes:
        robot, limits, options, line: as in `plan.cartesian.line.follow_line`.
        reach: (n,) largest motion of each joint between way-points, rad.
        length: length of the line, m, or rad for a pure rotation.
    """

    robot: Robot
    limits: Limits
    options: LineOptions
    reach: Array
    line: Line
    length: float

    def meet(self, goal: Array, before: Array, guess: Array, done: float) -> Array:
        """Return a configuration near `guess` with the tool at `goal` that satisfies all constraints.

        `before` is the previous way-point, and `done` the length of the line up to there, for messages.

        Raises:
            ImpossibleError: see `stopped`.
        """
        lower = np.maximum(self.limits.lower, before - self.reach)
        upper = np.minimum(self.limits.upper, before + self.reach)
        q = np.minimum(np.maximum(guess, lower), upper)
        # barriers are expensive: first search without them, then check the result
        careful, trust, worst, length = False, np.inf, np.inf, np.inf
        for _ in range(_MAX_STEPS):
            twist = _twist(self.robot.T_base_tool(q), goal, self.options.free_axis)
            there = np.abs(twist).max() <= _CONVERGED
            barrier = self.options.barrier(q) if self.options.barrier and (careful or there) else _NO_BARRIER
            left = float(barrier.h.min(initial=0.0))
            if there and left >= -_BARRIER_SLACK:
                return q
            if there and not careful:
                careful, q, trust, worst = True, before.copy(), _TRUST, np.inf
                continue
            # a step without progress was too long: the goal is out of reach, or a witness point jumped to another face
            bad = max(float(np.abs(_WEIGHT * twist).max()), -left)
            trust, worst = (trust if bad < 0.7 * worst else min(trust, length) / 2.0), bad
            step = self.step(q, twist, np.maximum(lower - q, -trust), np.minimum(upper - q, trust), barrier)
            if step is None and np.isfinite(trust):
                step = self.step(q, twist, lower - q, upper - q, barrier)
            if step is None:
                return self.stopped(goal, before, q, lower, upper, done)
            moved = np.minimum(np.maximum(q + step, lower), upper)
            length = float(np.abs(moved - q).max())
            q = moved
            if length < 1e-13:
                break
        off = Line(goal, goal).deviation(self.robot.T_base_tool(q)[None], self.options.free_axis)
        kept = not self.options.barrier or self.options.barrier(q).h.min(initial=0.0) >= -_BARRIER_SLACK
        near = off.distance[0] <= self.options.tolerance and off.angle[0] <= self.options.angle_tolerance
        if near and kept:
            return q
        return self.stopped(goal, before, q, lower, upper, done)

    def program(self, q: Array, twist: Array) -> tuple[Array, Array, float]:
        """Return J, e and damping of the quadratic program at q."""
        J, e, free = _WEIGHT[:, None] * self.robot.jacobian(q), _WEIGHT * twist, self.options.free_axis or ""
        rows = [r for r in range(6) if r < 3 or AXES[r - 3] not in free]
        redundant = free or (self.options.barrier is not None and len(rows) < len(q))
        return J[rows], e[rows], _FREE_DAMPING if redundant else _DAMPING

    def step(self, q: Array, twist: Array, lower: Array, upper: Array, barrier: Barrier) -> Array | None:
        """Solve the quadratic program; return the step, or None if it is infeasible."""
        J, e, damping = self.program(q, twist)
        free: Array = mul(J.T, solve_positive(mul(J, J.T) + damping * np.eye(len(J)), e))
        kept = not len(barrier.h) or (mul(barrier.G, free) <= barrier.h - _BARRIER_AIM).all()
        if kept and (free >= lower).all() and (free <= upper).all():
            return free
        spend(STEP_CHECKS)
        solution = _solve(J, e, damping, lower, upper, barrier, self.options.solver)
        return solution.x if solution.found else None

    def stopped(
        self, goal: Array, before: Array, q: Array, lower: Array, upper: Array, done: float
    ) -> NoReturn:
        """Raise an error for the constraint that stops the line at q, the one with the largest multiplier.

        Raises:
            ImpossibleError: always; data as in `plan.cartesian.line.follow_line`.
        """
        limits = self.limits
        barrier = self.options.barrier(q) if self.options.barrier else _NO_BARRIER
        twist = _twist(self.robot.T_base_tool(q), goal, self.options.free_axis)
        solution = _solve(*self.program(q, twist), lower - q, upper - q, barrier, self.options.solver)
        pull = np.abs(solution.z_box) if solution.found and solution.z_box is not None else np.zeros(len(q))
        rows = solution.z if solution.found and solution.z is not None and len(barrier.h) else np.zeros(0)
        on_limit = (q - limits.lower < ACTIVE) | (limits.upper - q < ACTIVE)
        too_fast = self.reach - np.abs(q - before) < ACTIVE
        blocking = np.where(on_limit | too_fast, pull + 1e-12, 0.0)
        joint = int(np.argmax(blocking))
        name: str | None = self.robot.joint_names[joint]
        row: int | None = None
        if not solution.found:
            constraint, name = "barrier", None
            text = "no step satisfies all of " + (", ".join(barrier.names) or "the joint limits")
            if len(barrier.h):
                row = int(np.argmin(barrier.h))
                text += f"; {barrier.label(row)} is the tightest"
        elif rows.max(initial=0.0) > blocking[joint]:
            row = int(np.argmax(rows))
            constraint, name = barrier.names[row], None
            text = f"{barrier.label(row)} is in the way"
        elif blocking[joint] == 0.0:
            constraint, name = "workspace", None
            text = "the pose there is out of the arm's reach or singular"
        elif on_limit[joint]:
            at_lower = q[joint] - limits.lower[joint] < ACTIVE
            side, value = ("lower", limits.lower[joint]) if at_lower else ("upper", limits.upper[joint])
            constraint = f"{name} {side} limit"
            text = f"joint {name} is at its {side} limit of {np.degrees(value):.2f} deg"
        else:
            constraint = f"{name} speed"
            text = (
                f"joint {name} cannot move fast enough ({np.degrees(limits.velocity[joint]):.3g} deg/s) even at "
                f"{self.options.slowest * 1e3:g} mm/s; the arm passes close to a singular configuration"
            )
        shown = f"{done * 1e3:.1f} of {self.length * 1e3:.1f} mm"
        if self.line.length <= self.options.tolerance:
            shown = f"{np.degrees(done):.2f} of {np.degrees(self.length):.2f} deg"
        apart = None if row is None or barrier.distance is None else float(barrier.distance[row])
        raise ImpossibleError(
            f"line stops after {shown}: {text}; try another configuration, rotation of the tool or place",
            constraint=constraint,
            joint=name,
            distance_m=apart,
            done_m=done,
            length_m=self.length,
        )


def _solve(
    J: Array, e: Array, damping: float, lower: Array, upper: Array, barrier: Barrier, solver: str
) -> qpsolvers.Solution:
    P = mul(J.T, J) + damping * np.eye(J.shape[1])
    G, h = (barrier.G, barrier.h - _BARRIER_AIM) if len(barrier.h) else (None, None)
    if solver == "osqp":
        P, G = scipy.sparse.csc_matrix(P), None if G is None else scipy.sparse.csc_matrix(G)
    problem = qpsolvers.Problem(P, mul(-J.T, e), G=G, h=h, lb=lower, ub=upper)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # `found` says what osqp could not solve
        return qpsolvers.solve_problem(problem, solver=solver, **_SETTINGS[solver])
