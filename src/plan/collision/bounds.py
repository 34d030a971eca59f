"""Cheap bounds on motion and distance of bodies, for many configurations at once.

A certificate needs to know whether two bodies can come nearer than some clearance while the joints move a little. For
most pairs, balls around the moving bodies and boxes around the fixed ones decide that, in numpy, for a whole batch of
configurations. coal computes exact distances only for the remaining pairs.

Geometry is stored in the base frame at q = 0. With the product of exponentials E_k(q) = exp(S_1 q_1) .. exp(S_k q_k),
a point p of a body on joint k is at E_k(q) p, and E_k(q) maps the axis of joint k from its place at q = 0 to its place
at q (K. Lynch, F. Park, "Modern Robotics", 2017, section 4.1.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from arm.former import renamed_arguments
from arm.numerics.products import mul
from arm.robot.model import LinkBody
from arm.robot.shapes import Convex
from arm.se3 import Array, Bools, Indices, cross
from plan.collision.covers import ROUNDING, hull, rounded_box
from plan.collision.separation import OpenPairs, Separation
from plan.kinematics.product_of_exponentials import axis_of


@renamed_arguments(turning="revolute")
class DistanceBounds:
    """Bounds on motion and distance of the pairs of one world, from balls, boxes and hulls of its bodies.

    Args:
        axes: axes of the arm.
        parts: all bodies; moving ones have a joint above 0.
        pairs: (p, 2) indices into `parts`; the body with the lower joint comes first.
        paddings: (p,) subtracted from the distance of each pair, m.
    """

    def __init__(self, axes: Axes, parts: Sequence[LinkBody], pairs: Indices, paddings: Array) -> None:
        self._axes = axes
        moving = [i for i, part in enumerate(parts) if part.joint > 0]
        at_zero = self._axes.poses_at_zero
        placed = np.stack([part.T_joint_body for part in parts]) if parts else np.zeros((0, 4, 4))
        poses = mul(at_zero[[part.joint for part in parts]], placed)
        self._hulls = _Hulls([(parts[i], poses[i]) for i in moving], self._axes.revolute)
        joints = np.array([part.joint for part in parts], dtype=np.intp)
        row = np.cumsum(joints > 0) - 1  # index among the moving bodies
        self._outer = row[pairs[:, 1]]
        self._shared, self._joints = joints[pairs].T
        self._pairs = pairs
        self._supports = _Supports(parts, poses)
        self._separation = Separation(parts, poses, pairs, paddings)

    @property
    def revolute(self) -> Bools:
        """Flags (n,): True for a revolute joint, False for a prismatic one."""
        return self._axes.revolute

    def placed(self, q: Array) -> Placed:
        """Place bodies and axes at configurations q (m, n) rad."""
        R, t = self._axes.place(q)
        point, axis = self._axes.lines(R, t)
        return Placed(q, R, t, point, axis, self._hulls)

    def motion_of(self, at: Placed, delta: Array, rows: Indices, pairs: Indices) -> Array:
        """Return upper bounds (k,) m on the relative motion of pairs.

        Args:
            at: m configurations.
            delta: (m, n) largest motion of each joint from there, rad, not negative.
            rows, pairs: (k,) indices of configurations and pairs.
        """
        return np.asarray((self.levers(at, rows, pairs) * delta[rows]).sum(axis=1))

    def levers(self, at: Placed, rows: Indices, pairs: Indices) -> Array:
        """Return bounds (k, n) m per rad on the relative motion of pairs by each joint; 0 for one that moves both.

        Args:
            at: m configurations.
            rows, pairs: (k,) indices of configurations and pairs.
        """
        radii = at.radii_of(rows, self._outer[pairs])
        return np.asarray(radii * (np.arange(radii.shape[1]) >= self._shared[pairs][:, None]))

    def distances(self, at: Placed) -> Array:
        """Return lower bounds (m, p) m on the distance of each pair; -inf if nothing is known."""
        return self._separation.distances(at.R, at.t)

    def open_pairs(self, at: Placed, enough: float, delta: Array | None = None) -> OpenPairs:
        """Return the pairs that may be closer than `enough` m, paddings taken off.

        Args:
            at: m configurations.
            enough: m.
            delta: (m, n) largest motion of each joint from there, rad, not negative; None for no motion.
        """
        outer, shared = self._outer[self._separation.ball_pairs], self._shared[self._separation.ball_pairs]
        if delta is None:
            still = np.zeros((len(at.q), self._hulls.count)), np.zeros((len(at.q), len(outer)))
            return self._separation.open_pairs(at.R, at.t, enough, *still)
        steps = np.zeros((*at.radii.shape[:2], at.radii.shape[2] + 1))
        np.cumsum(at.radii * delta[:, None, :], axis=2, out=steps[:, :, 1:])
        between = steps[:, outer, -1] - steps[:, outer, shared]
        return self._separation.open_pairs(at.R, at.t, enough, steps[:, :, -1], between)

    def plane_distances(
        self, at: Placed, rows: Indices, pairs: Indices, normals: Array, hulls: Array, spread: Array
    ) -> Array:
        """Return lower bounds (k,) m on distance over a whole motion, from separating planes.

        `plan.collision.certificate` derives the bound. It holds for any unit normal; the normal of the nearest points
        gives a tight one.

        Args:
            at: m configurations.
            rows, pairs: (k,) indices of configurations and pairs.
            normals: (k, 3) from the body with the lower joint to the other.
            hulls: (m, c, n) configurations; the motion stays in their convex hull to within `spread`.
            spread: (m, n) largest deviation of each joint from the hull.
        """
        n = at.axis.shape[1]
        joints = np.arange(n)
        low, high = self._shared[pairs], self._joints[pairs]
        between = (joints >= low[:, None]) & (joints < high[:, None])
        axis, point = at.axis[rows], at.point[rows]
        revolute = self._axes.revolute
        lever = np.where((between & revolute)[..., None], cross(normals[:, None], axis), 0.0)
        moves = hulls[rows] - at.q[rows, None]
        # n . (motion of a point p) is lever . (p - o) for a small rotation and n . axis for a prismatic joint
        at_zero = np.where(
            revolute, -(lever * point).sum(-1), np.where(between, (axis * normals[:, None]).sum(-1), 0.0)
        )
        tilted = normals[:, None] + mul(moves, lever)
        shift = (mul(moves, at_zero[..., None]))[..., 0]
        outer = -self._supports.of(self._pairs[pairs, 1], -tilted, at.R, at.t, rows)
        inner = self._supports.of(self._pairs[pairs, 0], normals[:, None], at.R, at.t, rows)[:, 0]
        first_order = (outer + shift).min(axis=1) - inner
        # the remainder of the linear form: points move on circles, and inner joints rotate the motion of outer ones
        radius = np.where(between, at.radii_of(rows, self._outer[pairs]), 0.0)
        deviation = spread[rows]
        delta = np.where(between, np.abs(moves).max(axis=1) + deviation, 0.0)
        inside = np.cumsum(delta, axis=1) - 0.5 * delta
        second_order = (radius * delta * inside).sum(axis=1)
        return np.asarray(first_order - (radius * deviation).sum(axis=1) - second_order - ROUNDING)


@dataclass(frozen=True, eq=False)
class Placed:
    """Bodies and axes at m configurations, in the base frame.

    Attributes:
        q: (m, n) rad.
        R, t: product of exponentials up to each joint, (m, n + 1, 3, 3) and (m, n + 1, 3) m.
        point, axis: a point (m, n, 3) m on each joint's axis, and its direction (m, n, 3).
        hulls: hulls of the moving bodies.
    """

    q: Array
    R: Array
    t: Array
    point: Array
    axis: Array
    hulls: _Hulls
    _known: dict[int, Array] = field(default_factory=dict)

    @cached_property
    def radii(self) -> Array:
        """Largest distance of each moving body from each axis, (m, bodies, n) m; see `plan.collision.certificate`."""
        self._measure(np.arange(self.hulls.count))
        shape = len(self.q), self.hulls.count, self.q.shape[1]
        return np.stack([self._known[i] for i in range(shape[1])], axis=1) if shape[1] else np.zeros(shape)

    def radii_of(self, rows: Indices, bodies: Indices) -> Array:
        """Return `radii` (k, n) of some moving bodies (k,) at some configurations (k,); no others are computed."""
        self._measure(bodies)
        out = np.empty((len(rows), self.q.shape[1]))
        for body in set(bodies.tolist()):
            mine = bodies == body
            out[mine] = self._known[body][rows[mine]]
        return out

    def _measure(self, bodies: Indices) -> None:
        new = np.array(sorted(set(bodies.tolist()) - set(self._known)), dtype=np.intp)
        if len(new):
            found = self.hulls.radii(self.R, self.t, self.point, self.axis, new)
            self._known.update(zip(new.tolist(), np.moveaxis(found, 1, 0), strict=True))


class Axes:
    """Joint axes of an arm at q = 0, and its product of exponentials up to each joint.

    Args:
        model: Pinocchio model of a chain of revolute and prismatic joints.
    """

    def __init__(self, model: Any) -> None:
        data = model.createData()
        # Pinocchio returns a vector for an arm with one joint
        twists = pin.computeJointJacobians(model, data, np.zeros(model.nq)).reshape(6, -1).T
        axes = [axis_of(twist) for twist in twists]
        self.poses_at_zero = np.stack([M.homogeneous for M in data.oMi])
        self.revolute: Bools = np.array([not axis.slides for axis in axes])
        self.point, self.direction = np.stack([(axis.point, axis.direction) for axis in axes], axis=1)
        self._along, self._across, self._turn = np.stack(
            [(axis.along, axis.across, axis.turn) for axis in axes], axis=1
        )
        self._lines = np.stack([self.point, self.direction], axis=-1)
        self._slide = np.where(self.revolute[:, None], 0.0, self.direction)

    def place(self, q: Array) -> tuple[Array, Array]:
        """Return rotations (m, n + 1, 3, 3) and translations (m, n + 1, 3) of E_0 .. E_n."""
        m, n = q.shape
        cosine, sine = np.cos(q)[..., None, None], np.sin(q)[..., None, None]
        step = np.empty((m, n, 3, 4))
        turn = step[..., :3]
        turn[:] = self._along + cosine * self._across + sine * self._turn
        step[..., 3] = self.point - mul(turn, self.point[..., None])[..., 0] + q[..., None] * self._slide
        placed = np.empty((m, n + 1, 3, 4))
        placed[:, 0] = np.eye(3, 4)
        product, count = step, 1  # of up to `count` joints: of all up to each, once `count` is n
        while count < n:
            longer = mul(product[:, :-count, :, :3], product[:, count:])
            longer[..., 3] += product[:, :-count, :, 3]
            product = np.concatenate([product[:, :count], longer], axis=1)
            count *= 2
        placed[:, 1:] = product
        return placed[..., :3], placed[..., 3]

    def lines(self, R: Array, t: Array) -> tuple[Array, Array]:
        """Return a point (m, n, 3) on each axis and its direction (m, n, 3)."""
        found = mul(R[:, 1:], self._lines)
        return found[..., 0] + t[:, 1:], found[..., 1]


class _Hulls:
    """Hulls of equal balls that contain the moving bodies: balls about their corners or the ends of their axes."""

    def __init__(self, bodies: Sequence[tuple[LinkBody, Array]], revolute: Bools) -> None:
        hulls = [hull(part.shape) for part, _ in bodies]
        self.ball = np.array([radius for _, radius in hulls])
        points = [
            mul(corners, T[:3, :3].T) + T[:3, 3] for (corners, _), (_, T) in zip(hulls, bodies, strict=True)
        ]
        self.points = np.concatenate(points) if points else np.zeros((0, 3))
        # explicit types and shapes, because an arm may have no bodies
        self.counts = np.array([len(p) for p in points], dtype=np.intp)
        self.count = len(self.counts)
        joints = np.array([part.joint for part, _ in bodies], dtype=np.intp)
        self.joint = np.repeat(joints, self.counts)
        self.moves = (np.arange(len(revolute)) < joints[:, None]).astype(float)
        self.revolute = revolute

    def radii(self, R: Array, t: Array, axis_point: Array, axis: Array, bodies: Indices) -> Array:
        """Return distances (m, k, n) m of bodies (k,), ascending, from the axes.

        The distance from the axis of a prismatic joint, which moves all points alike, is 1.
        """
        chosen = np.zeros(self.count, dtype=bool)
        chosen[bodies] = True
        own = np.repeat(chosen, self.counts)
        joint, counts = self.joint[own], self.counts[bodies]
        points = (mul(R[:, joint], self.points[own][..., None]))[..., 0] + t[:, joint]
        # |(p - o) x d|^2 = |p - o|^2 - ((p - o) . d)^2, expanded into matrix products
        along = mul(points, np.swapaxes(axis, 1, 2)) - (axis_point * axis).sum(-1)[:, None]
        square = (
            (points * points).sum(-1)[..., None]
            - mul(2.0 * points, np.swapaxes(axis_point, 1, 2))
            + (axis_point * axis_point).sum(-1)[:, None]
        )
        far = np.maximum.reduceat(square - along * along, np.cumsum(counts) - counts, axis=1)
        reach = np.sqrt(np.maximum(far, 0.0)) + (self.ball[bodies, None] + ROUNDING)
        return np.asarray(np.where(self.revolute, reach, 1.0) * self.moves[bodies])


class _Supports:
    """Support functions of the bodies: the largest d . p over the points p of a body."""

    def __init__(self, parts: Sequence[LinkBody], poses: Array) -> None:
        sizes = [rounded_box(part.shape) for part in parts]
        self.joint = np.array([part.joint for part in parts], dtype=np.intp)
        self.R = poses[:, :3, :3]
        middle = np.array([size[0] for size in sizes]).reshape(-1, 3, 1)
        self.middle = (mul(self.R, middle))[..., 0] + poses[:, :3, 3]
        self.half = np.array([size[1] for size in sizes]).reshape(-1, 3)
        self.tube, self.ball = np.array([size[2] for size in sizes]), np.array([size[3] for size in sizes])
        # a hull is held by the points of `hull` about the middle of its box, and by their ball, instead of by the box
        self.hull = np.array([isinstance(part.shape, Convex) for part in parts], dtype=bool)
        held = [hull(part.shape) for part in parts if isinstance(part.shape, Convex)]
        most = max((len(points) for points, _ in held), default=1)
        self.row = np.cumsum(self.hull) - 1
        self.points = np.zeros((len(held), 3, most))
        for row, ((points, radius), body) in enumerate(zip(held, np.flatnonzero(self.hull), strict=True)):
            self.points[row] = np.resize(points, (most, 3)).T - middle[body]
            self.half[body], self.ball[body] = 0.0, radius

    def of(self, bodies: Indices, directions: Array, R: Array, t: Array, rows: Indices) -> Array:
        """Return supports (k, c) m of bodies (k,) in directions (k, c, 3), at configurations `rows` (k,) of R and t."""
        joint = self.joint[bodies]
        turn = R[rows, joint]
        middle = (mul(turn, self.middle[bodies][..., None]))[..., 0] + t[rows, joint]
        local = mul(directions, mul(turn, self.R[bodies]))
        reach = (np.abs(local) * self.half[bodies][:, None]).sum(-1)
        reach += self.tube[bodies][:, None] * np.hypot(local[..., 0], local[..., 1])
        reach += self.ball[bodies][:, None] * np.sqrt((local * local).sum(-1))
        hulls = np.flatnonzero(self.hull[bodies])
        if len(hulls):
            reach[hulls] += mul(local[hulls], self.points[self.row[bodies[hulls]]]).max(axis=-1)
        return np.asarray(reach + (directions * middle[:, None]).sum(-1))
