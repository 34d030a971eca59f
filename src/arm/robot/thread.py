"""A ring on the tool that is threaded on a wire, and the proof that it stays threaded.

A ring that keeps a distance from a wire can leave it only over one of its ends. Two rays prolong the wire, one from
its free end and one from its foot. If the ring is proved clear of wire and rays during a motion, its linking number
with the line of all three, closed far away, does not change: crossing changes are the only ones (D. Rolfsen, "Knots
and Links", 1976, section 5D). So one linking number, at the start of the motion, holds for all of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from arm.arguments import numbers, shown
from arm.errors import ImpossibleError, InputError
from arm.numerics.products import mul, norm
from arm.robot.model import Robot
from arm.robot.shapes import Body, Capsule, Torus
from arm.se3 import Array, cross, frozen, transform

_RAY = 4.0  # m, length of a ray: further than an arm of this kind reaches
_RADIUS = 1e-4  # m, of a ray as a body


def ray_names(wire: str) -> tuple[str, str]:
    """Return the names of the bodies that prolong a wire at its free end and foot; no other body may have them."""
    return f"beyond {wire}", f"beyond the foot of {wire}"


@dataclass(frozen=True, eq=False)
class Thread:
    """A wire, and the ring that is threaded on it.

    Attributes:
        name: of the wire.
        ring: name of a body of the arm whose shape is a torus.
        line: centre line of the wire, (k, 3) m in the base frame, from its foot to its free end.

    Raises:
        InputError: not a line, or its first or last two points are the same.
    """

    name: str
    ring: str
    line: Array

    def __post_init__(self) -> None:
        line = numbers(self.line)
        fits = line is not None and line.ndim == 2 and line.shape[1] == 3 and len(line) > 1
        if (
            line is None
            or not fits
            or not np.isfinite(line).all()
            or min(norm(line[-1] - line[-2]), norm(line[1] - line[0])) < 1e-6
        ):
            why = (
                f"thread {self.name!r}: line = {shown(self.line)}: must be points (k, 3) m, the first two different, "
                "and the last two"
            )
            raise InputError(why, name=self.name)
        object.__setattr__(self, "line", frozen(line))

    @cached_property
    def rays(self) -> tuple[Body, Body]:
        """What prolongs the wire at its free end and at its foot, as thin bodies that only the ring must not touch."""
        beyond, behind = ray_names(self.name)
        return _ray(beyond, self.line[-2], self.line[-1]), _ray(behind, self.line[1], self.line[0])

    def exempt(self, names: list[str]) -> frozenset[frozenset[str]]:
        """Return the pairs of the rays with all of the bodies `names` but the ring."""
        return frozenset(
            frozenset((ray.name, name)) for ray in self.rays for name in names if name != self.ring
        )

    def linking_number(self, robot: Robot, q: Array) -> int:
        """Return how often the line of wire and rays passes through the ring at q (n,), less how often it returns.

        Raises:
            InputError: the arm has no torus of that name.
        """
        ring = next((body for body in robot.bodies if body.name == self.ring), None)
        if ring is None or not isinstance(ring.shape, Torus):
            why = f"thread {self.name!r}: ring = {self.ring!r}: must be a body of the arm whose shape is a torus"
            raise InputError(why, name=self.ring)
        T = mul(robot.joint_poses(q)[ring.joint], ring.T_joint_body)
        beyond, behind = (ray.T_base_body[:3, 3] + 0.5 * _RAY * ray.T_base_body[:3, 2] for ray in self.rays)
        points = mul(np.concatenate([behind[None], self.line, beyond[None]]) - T[:3, 3], T[:3, :3])
        low, high = points[:-1], points[1:]
        above = points[:, 2] > 0.0
        through = above[1:] != above[:-1]
        part = low[through, 2] / (low[through, 2] - high[through, 2])
        at = low[through, :2] + part[:, None] * (high[through, :2] - low[through, :2])
        inside = (at**2).sum(axis=1) < ring.shape.radius**2
        return int(np.where(above[1:][through], 1, -1)[inside].sum())

    def require_threaded(self, robot: Robot, q: Array, name: str) -> None:
        """Require that the ring is threaded at q (n,), the start of the move `name`.

        Raises:
            ImpossibleError: it is not; data: step, linking_number.
        """
        number = self.linking_number(robot, q)
        if abs(number) != 1:
            raise ImpossibleError(
                f"{name!r} begins with {self.ring} not threaded on {self.name}: linking number {number}, must be +-1",
                step=name,
                linking_number=number,
            )

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types, m, to 1 pm."""
        return {"name": self.name, "ring": self.ring, "line": (np.round(self.line, 12) + 0.0).tolist()}


def _ray(name: str, before: Array, end: Array) -> Body:
    """Return the ray from the end of a line on, in the direction that it has there."""
    z = (end - before) / norm(end - before)
    x = cross(np.eye(3)[int(np.argmin(np.round(np.abs(z), 9)))], z)
    x = x / norm(x)
    R = np.stack([x, cross(z, x), z], axis=1)
    return Body(name, Capsule(_RADIUS, _RAY), transform(R, end + 0.5 * _RAY * z), "ray")


def thread_from_json(value: Any) -> Thread:
    """Invert `Thread.to_json`.

    Raises:
        InputError: the value is malformed.
    """
    if not isinstance(value, dict) or not all(isinstance(value.get(key), str) for key in ("name", "ring")):
        raise InputError(f"thread {str(value)[:60]}: must have name, ring and line; plan again")
    return Thread(value["name"], value["ring"], value.get("line", ()))
