"""One way-point of a line after the other, by differential inverse kinematics as a quadratic program.

At each way-point of the line, from a configuration q near it, steps dq are taken that solve

    minimise   |J dq - e|^2 + small |dq|^2        e: twist from the tool to the way-point, tool axes
    subject to lower <= q + dq <= upper           joint limits
               |dq since the last way-point| <= velocity * (time at the slowest speed that is allowed)
               G dq <= h                          what the caller adds, such as
               `plan.cartesian.collision_barrier.collision_barrier`

until e vanishes (S. Caron's "Inverse kinematics" notes and pink use the same form). Where the minimum without
constraints keeps all of them it is the answer, and no solver is asked. A way-point that cannot be met is an error
that names the constraint which holds it back; a shorter line is never returned.
"""

from __future__ import annotations

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
from plan.kinematics.straight_line import AXES, Line, LineDeviation

SOLVERS = ("daqp", "osqp")
ACTIVE = 1e-7  # rad from a bound that counts as lying on it
_ROTATION_SCALE = 0.2  # m per rad: weighs the tool's rotation against its translation
_DAMPING = 1e-10
_FREE_DAMPING = 1e-6  # with a free axis: keeps the quadratic program well conditioned
_CONVERGED = 1e-10  # m and rad
_MAX_STEPS = 40
_TRUST = 0.1  # rad (m for a sliding joint), of a step along barriers
_BARRIER_SLACK = 1e-9  # of a barrier's h at a way-point
_BARRIER_AIM = 1e-7  # what a step keeps away from a barrier, so that its curvature leaves it kept
# daqp is exact up to its tolerance on bounds; osqp needs tight ones to be any use here
_SETTINGS: dict[str, dict[str, float | int]] = {
    "daqp": {"primal_tol": 1e-9},
    "osqp": {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000, "raise_error": False},
}


@dataclass(frozen=True)
class Barrier:
    """Rows G dq <= h that a step must keep, with a name each for messages; (k, n), (k,).

    h is what is left of each constraint at q: at no way-point may it be negative. `distance` (k,) is what is
    reported, m: how far the bodies of a row are apart, where it stands for bodies.
    """

    G: Array
    h: Array
    names: tuple[str, ...]
    distance: Array | None = None

    def told(self, row: int) -> str:
        """Name of a row, with its distance."""
        if self.distance is None:
            return self.names[row]
        return f"{self.names[row]} ({self.distance[row] * 1e3:.2f} mm apart)"


_NO_BARRIER = Barrier(np.zeros((0, 0)), np.zeros(0), ())


@dataclass(frozen=True)
class LineOptions:
    """How a line is followed.

    Attributes:
        step: distance of way-points at most, m; `step_angle` the same for rotation, rad. Both are halved until the
            spline through the way-points keeps the tolerances too.
        tolerance, angle_tolerance: of the tool, at way-points and between them, m and rad.
        slowest: the tool may have to go as slowly as this for the joints to keep up, m/s; slower is refused.
        solver: one of `SOLVERS`.
        barrier: called with q (n,), gives further rows; or None.
        free_axis: the tool may turn about this axis of its own as it likes (one of `AXES`), or None. It turns as
            little as it can.
    """

    step: float = 0.005
    step_angle: float = 0.05
    tolerance: float = 1e-5
    angle_tolerance: float = 8.7e-5
    slowest: float = 0.002
    solver: str = "daqp"
    barrier: Callable[[Array], Barrier] | None = field(default=None, compare=False)
    free_axis: str | None = None


def _twist(T: Array, goal: Array, free_axis: str | None) -> Array:
    """From the tool at T to the goal: metres and rad in the tool's axes (6,), exact to first order.

    With a free axis its rotation is 0, and the other two bring the axis onto the goal's.
    """
    R = T[:3, :3]
    apart = mul(R.T, goal[:3])
    twist = np.empty(6)
    twist[:3] = apart[:, 3] - mul(R.T, T[:3, 3])
    if free_axis is not None:
        axis = AXES.index(free_axis)
        twist[3:] = np.cross(np.eye(3)[axis], apart[:, axis])
    elif apart[0, 0] + apart[1, 1] + apart[2, 2] > 2.98:  # below 0.15 rad the sine does
        twist[3] = 0.5 * (apart[2, 1] - apart[1, 2])
        twist[4] = 0.5 * (apart[0, 2] - apart[2, 0])
        twist[5] = 0.5 * (apart[1, 0] - apart[0, 1])
    else:
        twist[3:] = rotation_vector(apart[:, :3])
    return twist


_WEIGHT = np.array([1.0, 1.0, 1.0, _ROTATION_SCALE, _ROTATION_SCALE, _ROTATION_SCALE])


@dataclass(frozen=True, eq=False)
class Follower:
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
        q = np.minimum(np.maximum(guess, lower), upper)
        # barriers cost far more than the rest: they are asked for first where the line would go without them
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
            # a step that made nothing better was too long: out of reach, or a witness point jumped to another face
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
        off = self.line_error(q, goal)
        kept = not self.options.barrier or self.options.barrier(q).h.min(initial=0.0) >= -_BARRIER_SLACK
        if (
            off.distance[0] <= self.options.tolerance
            and off.angle[0] <= self.options.angle_tolerance
            and kept
        ):
            return q
        return self.stopped(goal, before, q, lower, upper, done)

    def line_error(self, q: Array, goal: Array) -> LineDeviation:
        """How far the tool at q is off a goal."""
        return Line(goal, goal).deviation(self.robot.T_base_tool(q)[None], self.options.free_axis)

    def program(self, q: Array, twist: Array) -> tuple[Array, Array, float]:
        """J, e and damping of the step at q."""
        J, e = _WEIGHT[:, None] * self.robot.jacobian(q), _WEIGHT * twist
        if self.options.free_axis is None:
            return J, e, _DAMPING
        rows = [r for r in range(6) if r != 3 + AXES.index(self.options.free_axis)]
        return J[rows], e[rows], _FREE_DAMPING

    def step(self, q: Array, twist: Array, lower: Array, upper: Array, barrier: Barrier) -> Array | None:
        """The step that the program of the module's head gives, or None where none keeps its constraints."""
        J, e, damping = self.program(q, twist)
        free: Array = mul(J.T, solve_positive(mul(J, J.T) + damping * np.eye(len(J)), e))
        kept = not len(barrier.h) or (mul(barrier.G, free) <= barrier.h - _BARRIER_AIM).all()
        if kept and (free >= lower).all() and (free <= upper).all():
            return free
        solution = _solve(J, e, damping, lower, upper, barrier, self.options.solver)
        return solution.x if solution.found else None

    def stopped(
        self, goal: Array, before: Array, q: Array, lower: Array, upper: Array, done: float
    ) -> NoReturn:
        """Raise the error that says which constraint stopped the line at q, by its multiplier where several do."""
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
            text = "no step keeps all of " + (", ".join(barrier.names) or "the joint limits")
            if len(barrier.h):
                row = int(np.argmin(barrier.h))
                text += f"; {barrier.told(row)} is the tightest"
        elif rows.max(initial=0.0) > blocking[joint]:
            row = int(np.argmax(rows))
            constraint, name = barrier.names[row], None
            text = f"{barrier.told(row)} is in the way"
        elif blocking[joint] == 0.0:
            constraint, name = "workspace", None
            text = "the pose is out of the arm's reach or singular there"
        elif on_limit[joint]:
            at_lower = q[joint] - limits.lower[joint] < ACTIVE
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
        apart = None if row is None or barrier.distance is None else float(barrier.distance[row])
        raise ImpossibleError(
            f"line stops after {shown}: {text}; another configuration, turn of the tool or place may do",
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
    return qpsolvers.solve_problem(problem, solver=solver, **_SETTINGS[solver])
