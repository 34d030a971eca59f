"""Does a motion keep a ring threaded, and clear? A written oracle, apart from planner and certificate.

Threaded: the linking number of the ring's circle with the line of wire and ray, closed far away, is 1 or -1 at every
sample of the motion, and the ring keeps the distance that is required from the ray. It is Gauss's integral over two
polygons (K. Klenin, J. Langowski, "Computation of writhe in modeling of supercoiled DNA", Biopolymers 54, 2000, method
1a). Clear: all bodies of the arm keep that distance from all bodies of the scene, by coal; the ring is a mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import coal
import numpy as np
import numpy.typing as npt

from arm.robot.shapes import Torus
from arm.se3 import cross
from cell.sim.touches import geometry
from plan.scene import Scene

Array = npt.NDArray[np.float64]

RAY, FAR = 4.0, 10.0  # m
SIDES = 16  # of the polygon that stands for the ring's circle
STEP = 0.03  # rad of any joint between samples
REFINED = 0.002  # rad, around the least distances
CLOSE = 0.004  # m: samples with less than that to spare are looked at more closely


def linking(ring: Array, line: Array) -> float:
    """Return the linking number of two closed polygons (n, 3) and (k, 3), as it is computed: not rounded."""
    a, b = ring[:, None], np.roll(ring, -1, axis=0)[:, None]
    c, d = line[None], np.roll(line, -1, axis=0)[None]
    r13, r14, r23, r24, r34, r12 = c - a, d - a, c - b, d - b, d - c, b - a
    normals = [cross(*pair) for pair in ((r13, r14), (r14, r24), (r24, r23), (r23, r13))]
    normals = [n / np.sqrt(np.maximum((n * n).sum(axis=2, keepdims=True), 1e-60)) for n in normals]
    angle = sum(
        np.arcsin(np.clip((normals[i] * normals[(i + 1) % 4]).sum(axis=2), -1.0, 1.0)) for i in range(4)
    )
    sign = np.sign((cross(r34, r12) * r13).sum(axis=2))
    return float((angle * sign).sum() / (4.0 * np.pi))


def closed(line: Array) -> Array:
    """Return a wire's line (k, 3) from its foot to its free end, with a ray at each end, closed far from any arm."""
    ahead = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
    aside = np.cross(ahead, (0.0, 0.0, 1.0)) if abs(ahead[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    aside = FAR * aside / np.linalg.norm(aside)
    behind = (line[0] - line[1]) / np.linalg.norm(line[0] - line[1])
    tip, below = line[-1] + RAY * ahead, line[0] + RAY * behind
    return np.concatenate([line, [tip, tip + aside, below + aside, below]])


@dataclass(frozen=True)
class Judgement:
    """What the oracle says of a motion.

    Attributes:
        linked: whether the ring is on the line of wire and ray at every sample.
        bodies: least distance less paddings, m, of all bodies that must not meet.
        ray: least distance of ring and rays, m.
        pair: names of the bodies that are nearest.
    """

    linked: bool
    bodies: float
    ray: float
    pair: tuple[str, str]

    @property
    def least(self) -> float:
        """Least distance of all, m."""
        return min(self.bodies, self.ray)


class ThreadOracle:
    """Judges motions of one arm in one scene.

    Args:
        scene: the arm and all bodies.
        name: of the thread.
    """

    def __init__(self, scene: Scene, name: str) -> None:
        thread = scene.thread(name)
        self.robot, self.line = scene.robot_open, closed(thread.line)
        self.ring, self.rays = thread.ring, {ray.name for ray in thread.rays}
        bodies = [*scene.bodies, *thread.rays]
        fixed = [(b, coal.CollisionObject(geometry(b.shape), _pose(b.T_base_body))) for b in bodies]
        exempt = scene.allowed | self.robot.disabled_collisions
        self.bodies = [(b, geometry(b.shape)) for b in self.robot.bodies]
        self.pairs = [
            (i, other, body.padding + still.padding, (body.name, still.name))
            for (i, (body, _)), (still, other) in product(enumerate(self.bodies), fixed)
            if frozenset((body.name, still.name)) not in exempt
            and (still.kind != "ray" or body.name == thread.ring)
            and body.joint > 1  # the base stands on the table
        ]
        angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
        shape = next(b.shape for b in self.robot.bodies if b.name == thread.ring)
        if not isinstance(shape, Torus):
            raise TypeError(f"{thread.ring} is no torus")
        self.circle = shape.radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)

    def judge(self, q: Array, required: float) -> Judgement:
        """Return the judgement of straight motions of the joints through q (k, n) rad."""
        path = _dense(q, STEP)
        found = [self._at(path[0])]
        for a, b in pairwise(path):
            found.append(self._at(b))
            if min(abs(one.least - required) for one in found[-2:]) < CLOSE:  # undecided between samples
                found += [self._at(between) for between in _dense(np.stack([a, b]), REFINED)[1:-1]]
        nearest = min(found, key=lambda one: one.bodies)
        return replace(nearest, linked=all(one.linked for one in found), ray=min(one.ray for one in found))

    def _at(self, q: Array) -> Judgement:
        joints = self.robot.joint_poses(q)
        T = [joints[body.joint] @ body.T_joint_body for body, _ in self.bodies]
        at = next(T for T, (body, _) in zip(T, self.bodies, strict=True) if body.name == self.ring)
        number = linking(self.circle @ at[:3, :3].T + at[:3, 3], self.line)
        moved = [coal.CollisionObject(g, _pose(pose)) for pose, (_, g) in zip(T, self.bodies, strict=True)]
        bodies, ray, pair = np.inf, np.inf, ("", "")
        for i, still, padding, names in self.pairs:
            is_ray = names[1] in self.rays
            if not is_ray and _boxes_apart(moved[i], still) - padding > bodies:
                continue
            apart = coal.distance(moved[i], still, coal.DistanceRequest(), coal.DistanceResult()) - padding
            if is_ray:
                ray = min(ray, apart)
            elif apart < bodies:
                bodies, pair = apart, names
        return Judgement(abs(abs(number) - 1.0) < 0.1, bodies, ray, pair)


def _boxes_apart(a: Any, b: Any) -> float:
    return float(a.getAABB().distance(b.getAABB()))


def _pose(T: Array) -> Any:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


def _dense(q: Array, step: float) -> Array:
    """Return straight joint motions (k, n) with more points: no joint moves further than a step between two."""
    found = [q[:1]]
    for a, b in pairwise(q):
        count = max(1, int(np.ceil(np.abs(b - a).max() / step)))
        found.append(a + np.linspace(0.0, 1.0, count + 1)[1:, None] * (b - a))
    return np.concatenate(found)
