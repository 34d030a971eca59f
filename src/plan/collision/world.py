"""The collision world: distances between an arm, the body it holds, and the bodies around it, computed by coal.

Each pair of bodies that must not touch is a collision pair of a Pinocchio geometry model, so forward kinematics,
broadphase and distances run in C++. Pairs of the arm's own bodies (self-collision) are among them, except those that
the SRDF disables. Two bodies on the same joint, or two fixed bodies, have no relative motion and make no pair.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import isfinite
from typing import Any

import coal
import numpy as np
import numpy.typing as npt

from arm import arguments as given
from arm.errors import InputError
from arm.numerics.products import mul
from arm.robot.model import LinkBody, Robot
from arm.robot.shapes import Body, Torus
from arm.se3 import Array, Bools, Indices, cross, frozen
from plan.budget import DISTANCE_CHECKS, spend
from plan.collision.bounds import Axes, DistanceBounds
from plan.collision.narrow.coal_shapes import GJK_TOLERANCE, coal_shape
from plan.collision.narrow.torus_pairs import torus_distance
from plan.collision.pair_geometry import PairGeometry

_FLOAT = np.dtype(float)

# Largest error of a distance, m, which lower bounds subtract: 50 times the largest difference measured between GJK at
# this tolerance and MuJoCo on the same primitives.
DISTANCE_ERROR = 1e-5
# Kinds of bodies that a program may move.
MOVABLE = ("cube", "work")
# Distance that stands for a depth that coal cannot compute (in a few of a million configurations), m.
UNKNOWN_DEPTH = -1.0


@dataclass(frozen=True)
class Witnesses:
    """Distances of k pairs, with normals and witness points.

    Attributes:
        distance: (k,) m; minus the depth if the bodies overlap.
        normal: (k, 3) unit vectors from the inner body (nearer to the base in the chain) to the outer one.
        point: (k, 3) m, on the outer body.
    """

    distance: Array
    normal: Array
    point: Array


@dataclass(frozen=True)
class Near:
    """r pairs of bodies near each other at some of several configurations.

    Attributes:
        row: (r,) index of the configuration.
        pair: (r,) index of the pair.
        distance: (r,) m.
        gradient: (r, n) of the distance with respect to the joints, m/rad (1 for a prismatic joint along the normal).
    """

    row: Indices
    pair: Indices
    distance: Array
    gradient: Array

    def chosen(self, some: Bools) -> Near:
        """Return some (r,) of them."""
        return Near(self.row[some], self.pair[some], self.distance[some], self.gradient[some])


@dataclass(frozen=True)
class Distance:
    """Smallest distance between two bodies.

    Attributes:
        value: m; minus the depth if they overlap.
        pair: their names, the one nearer to the tool first.
        points: witness points on the first and second body, (2, 3) m in the base frame.
    """

    value: float
    pair: tuple[str, str]
    points: Array


class World:
    """One arm, with or without a held body, among fixed bodies.

    Not thread-safe: it contains Pinocchio's workspace.

    Args:
        robot: the arm, with its jaws in place.
        bodies: fixed bodies; overlaps between them are not checked.
        held: a body that moves with the tool, or None.
        T_tool_held: its pose in the tool frame, 4x4; required with `held`.
        allowed: allowed collisions, pairs of names.
        padding: subtracted from every distance in addition to the paddings of the two bodies, m.

    Raises:
        InputError: `held` without `T_tool_held`, two bodies of one name, a pose that is not rigid, `allowed` that are
            not pairs, or a negative padding. Methods raise it for a configuration without one finite number per joint.

    Attributes:
        robot: the arm.
        padding: m.
        paddings: of each pair, (p,) m: `padding` plus those of its two bodies.
        names: of all bodies: the arm's, then the held one, then the fixed ones.
        pairs: indices into `names` of each checked pair, (p, 2); the body nearer to the base first.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Sequence[Body],
        held: Body | None = None,
        T_tool_held: npt.ArrayLike | None = None,
        allowed: Iterable[frozenset[str]] = (),
        padding: float = 0.0,
    ) -> None:
        if held is not None and T_tool_held is None:
            raise InputError(f"held = {held.name!r}: T_tool_held must be given as well", name=held.name)
        for body in (*bodies, *([] if held is None else [held])):
            if not isinstance(body, Body):
                raise InputError(f"bodies: {given.shown(body)}: must be a Body", value=given.shown(body))
        allowed = given.pairs("allowed", allowed)
        self._made_of = robot, tuple(bodies), held, T_tool_held, allowed, padding
        self.robot, self._moving = robot, [body for body in bodies if body.kind in MOVABLE]
        self.padding = given.number("padding", padding, 0.0, 100.0, "m", "distances are reduced by it")
        given.rigid("robot.T_end_tool", robot.T_end_tool)
        n = int(robot.model.nq)
        self._shape = (n,)
        parts = list(robot.bodies)
        if held is not None:
            T_joint_tool = mul(robot.T_joint_end, robot.T_end_tool)
            pose = mul(T_joint_tool, given.rigid("T_tool_held", T_tool_held))
            parts.append(LinkBody(held.name, robot.end_joint, held.shape, frozen(pose), held.padding))
        parts += [LinkBody(b.name, 0, b.shape, b.T_base_body, b.padding) for b in bodies]
        self.names = tuple(p.name for p in parts)
        if len(set(self.names)) != len(parts):
            raise InputError(f"bodies: names must differ: {', '.join(self.names)}", names=list(self.names))

        self.pairs = _pairs(parts, robot.disabled_collisions | allowed)
        self.paddings = frozen(self.padding + np.array([p.padding for p in parts])[self.pairs].sum(axis=1))
        self._joint = np.array([p.joint for p in parts], dtype=np.intp)
        # joints that move the bodies of a pair relative to each other
        joint = np.arange(1, n + 1)
        inner, outer = self._joint[self.pairs].T[..., None]
        self._between = (joint > inner) & (joint <= outer)
        self._parts = parts
        self._too_near: dict[float, Callable[[Array], bool]] = {}

    @cached_property
    def _geometry(self) -> PairGeometry:
        return PairGeometry(self.robot.model, self._parts, self.pairs, self.paddings)

    @cached_property
    def volumes(self) -> DistanceBounds:
        """Bounds on motion and distance of the pairs, for many configurations at once."""
        return DistanceBounds(_axes(self.robot), self._parts, self.pairs, self.paddings)

    def pair_names(self, index: int) -> tuple[str, str]:
        """Return the two bodies of pair `index`, the one nearer to the tool first."""
        inner, outer = self.pairs[index]
        return self.names[outer], self.names[inner]

    def pair_distances(self, q: npt.ArrayLike, pairs: Indices) -> Array:
        """Return signed distances (k,) m, less paddings, of the pairs `pairs` (k,) at configuration q (n,)."""
        found = self._geometry.distances(self._configuration(q), pairs)
        values = [result.min_distance for result in found]
        spend(DISTANCE_CHECKS * len(values))
        return np.asarray(np.maximum(values, UNKNOWN_DEPTH) - self.paddings[pairs])

    def witnesses(
        self, q: npt.ArrayLike, rows: Indices, pairs: Indices, stop_below: float = -np.inf
    ) -> Witnesses:
        """Return signed distances, less paddings, of pairs at some of several configurations.

        Args:
            q: (m, n) rad.
            rows, pairs: (k,) indices of configurations, in ascending order, and of pairs.
            stop_below: stop after the first distance below this, m.
        """
        least = stop_below + self.paddings[pairs]
        values, normals, points = self._geometry.witnesses(self._configurations(q), rows, pairs, least)
        spend(DISTANCE_CHECKS * len(values))
        return Witnesses(
            np.maximum(values, UNKNOWN_DEPTH) - self.paddings[pairs[: len(values)]], normals, points
        )

    def only(self, names: Iterable[str]) -> World:
        """Return the same world with only those pairs that contain a body of `names`.

        Raises:
            InputError: a name is not that of a body.
        """
        robot, bodies, held, T_tool_held, allowed, padding = self._made_of
        left_out = [frozenset(self.pair_names(i)) for i in np.flatnonzero(~self.pairs_of(names)).tolist()]
        return World(robot, bodies, held, T_tool_held, (*allowed, *left_out), padding)

    def pairs_of(self, names: Iterable[str]) -> Bools:
        """Return which pairs (p,) contain a body of `names`.

        Raises:
            InputError: a name is not that of a body.
        """
        wanted = set(names)
        unknown = sorted(wanted - set(self.names))
        if unknown:
            why = f"names: {unknown[0]!r}: must be one of {', '.join(self.names)}"
            raise InputError(why, name=unknown[0])
        named = np.array([name in wanted for name in self.names], dtype=bool)
        return np.asarray(named[self.pairs].any(axis=1))

    def joint_of(self, name: str) -> int:
        """Return the index of the joint that moves a body, 1 to n; 0 for a fixed body."""
        return int(self._joint[self.names.index(name)])

    def state(self, q: npt.ArrayLike) -> dict[str, Any]:
        """Return what a program can change of this world, and the configuration q (n,) rad, as data of a refusal.

        It has one key, ``at``, with JSON types: q; robot, the digest of the arm with its jaws in place; held, the name
        of the held body, with T_tool_held, or None; moved, the pose T_base_body of each movable body, by name.
        """
        _, _, held, T_tool_held, _, _ = self._made_of
        return {
            "at": {
                "q": np.round(self._configuration(q), 12).tolist(),
                "robot": self.robot.digest,
                "held": None if held is None else held.name,
                "T_tool_held": None if held is None else np.round(np.asarray(T_tool_held), 12).tolist(),
                "moved": {body.name: np.round(body.T_base_body, 12).tolist() for body in self._moving},
            }
        }

    def distance(self, q: npt.ArrayLike) -> Distance:
        """Return the smallest distance over all pairs at configuration q (n,) rad; infinite if there is no pair."""
        at = self._configuration(q)[None]
        spend(DISTANCE_CHECKS * len(self.pairs))
        bounds = self.volumes.distances(self.volumes.placed(at))[0] - self.paddings
        order = np.argsort(bounds, kind="stable")
        results = self._geometry.distances(at[0], order)
        closest, least, witness = -1, float("inf"), None
        for i in order.tolist():
            # a computed distance may be below its bound by its error
            if bounds[i] > least + DISTANCE_ERROR:
                break
            result = next(results)
            value = max(result.min_distance, UNKNOWN_DEPTH) - float(self.paddings[i])
            if value < least or (value == least and i < closest):
                closest, least, witness = i, value, result
        if witness is None:
            return Distance(least, ("", ""), frozen(np.full((2, 3), np.nan)))
        return self._witness(closest, least, witness)

    def distances_below(self, q: npt.ArrayLike, limit: float) -> list[Distance]:
        """Return every pair closer than `limit` m at configuration q (n,) rad, the closest first.

        Raises:
            InputError: q does not have one finite number per joint, or `limit` is NaN.
        """
        limit = given.number("limit", limit, -np.inf, np.inf, "m")
        every = np.arange(len(self.pairs))
        results = list(self._geometry.distances(self._configuration(q), every))
        spend(DISTANCE_CHECKS * len(results))
        values = np.maximum([result.min_distance for result in results], UNKNOWN_DEPTH) - self.paddings
        order = [int(i) for i in np.argsort(values, kind="stable") if values[i] < limit]
        return [self._witness(i, float(values[i]), results[i]) for i in order]

    def near(self, q: npt.ArrayLike, limit: float | Array) -> Near:
        """Return every pair closer than `limit` m at configurations q (m, n) rad, with the gradient of its distance.

        The limit is that of all pairs, or one for each (p,). The gradient is the velocity of the outer body's witness
        point relative to the inner body, along the normal; the bodies' curvature adds terms of second order only.
        """
        q = self._configurations(q)
        at = self.volumes.placed(q)
        limits = np.broadcast_to(limit, (len(self.pairs),))
        open_ = self.volumes.open_pairs(at, float(limits.max(initial=-np.inf)))
        chosen = open_.bound < limits[open_.pair]
        row, pair = open_.row[chosen], open_.pair[chosen]
        found = self.witnesses(q, row, pair)
        close = found.distance < limits[pair]
        row, pair = row[close], pair[close]
        normal, point = found.normal[close][:, None], found.point[close][:, None]
        axis_point, axis = at.point[row], at.axis[row]
        motion = np.where(self.volumes.revolute[:, None], cross(axis, point - axis_point), axis)
        gradient = np.where(self._between[pair], (motion * normal).sum(-1), 0.0)
        return Near(row, pair, found.distance[close], gradient)

    def in_collision(self, q: npt.ArrayLike, clearance: float = 0.0) -> bool:
        """Return whether some pair is closer than `clearance` m at configuration q (n,) rad; uses coal's broadphase."""
        return self.too_near(clearance)(self._configuration(q))

    def too_near(self, clearance: float) -> Callable[[Array], bool]:
        """Return `in_collision` as a fast function of q for searches; q must be an array (n,) of finite floats.

        Raises:
            InputError: `clearance` is not a finite number.
        """
        test = self._too_near.get(clearance)
        if test is None:  # always None for NaN, which is not equal to itself
            given.finite("clearance", clearance, "m")
            test = self._geometry.too_near(clearance) if len(self.pairs) else lambda q: False
            self._too_near[clearance] = test
        return test

    def _configuration(self, q: npt.ArrayLike) -> Array:
        """Return q (n,) after a check, which takes 0.5 us in the usual case; a search calls this a million times."""
        if (
            type(q) is np.ndarray
            and q.dtype is _FLOAT
            and q.shape == self._shape
            and isfinite(sum(q.tolist()))
        ):
            return q
        return given.joints("q", q, self.robot.joint_names)

    def _configurations(self, q: npt.ArrayLike) -> Array:
        """Return q (m, n) after a check."""
        q = np.asarray(q, dtype=float)
        if q.ndim != 2 or q.shape[1:] != self._shape or not np.isfinite(q).all():
            why = f"q = array of shape {q.shape}: must be (m, {self._shape[0]}) finite numbers, rad"
            raise InputError(why, shape=q.shape)
        return q

    def _witness(self, index: int, value: float, result: Any) -> Distance:
        points = frozen([result.getNearestPoint2(), result.getNearestPoint1()])
        return Distance(value, self.pair_names(index), points)


@lru_cache(maxsize=32)
def _axes(robot: Robot) -> Axes:
    return Axes(robot.model)


def _pairs(parts: Sequence[LinkBody], excluded: frozenset[frozenset[str]]) -> Indices:
    joint = np.array([part.joint for part in parts], dtype=np.intp)
    first, second = np.triu_indices(len(parts), k=1)
    apart = joint[first] != joint[second]
    first, second = first[apart], second[apart]
    number = {part.name: i for i, part in enumerate(parts)}
    left_out = {tuple(sorted(number.get(name, -1) for name in pair)) for pair in excluded}
    kept = [pair not in left_out for pair in zip(first.tolist(), second.tolist(), strict=True)]
    pairs = np.stack([first, second], axis=1)[kept]
    swapped = joint[pairs[:, 0]] > joint[pairs[:, 1]]
    pairs[swapped] = pairs[swapped, ::-1]
    return np.asarray(pairs, dtype=np.intp)


def distance_of(first: Body, second: Body) -> Distance:
    """Return the distance of two bodies at their poses."""
    names = first.name, second.name
    if isinstance(first.shape, Torus) or isinstance(second.shape, Torus):
        found = torus_distance(first, second)
        return Distance(found.min_distance, names, frozen([found.inner, found.outer]))
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = GJK_TOLERANCE
    placed = [
        coal.Transform3s(np.array(b.T_base_body[:3, :3]), np.array(b.T_base_body[:3, 3]))
        for b in (first, second)
    ]
    value = coal.distance(
        coal_shape(first.shape), placed[0], coal_shape(second.shape), placed[1], request, result
    )
    points = frozen([result.getNearestPoint1(), result.getNearestPoint2()])
    return Distance(max(float(value), UNKNOWN_DEPTH), names, points)
