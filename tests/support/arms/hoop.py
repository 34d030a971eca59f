"""A ring at the flange of the A465, and a square bar through it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from arm.controller.unit import load_unit
from arm.robot.gripper import HAND
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Box, Capsule, Torus
from arm.robot.tool import with_tool
from arm.se3 import Array, frozen, rot_x, rot_z, rotation, transform
from arms.grazing import place
from plan.collision.bezier import Curve, curve_of_waypoints
from plan.collision.world import World
from plan.kinematics.ik import inverse_kinematics
from tasks.task2 import TABLE, TOOL_LENGTH

RING = Torus(0.0324, 0.0048)
SIDE = 0.01  # of the bar, m
T_END_RING = transform(np.diag([-1.0, 1.0, -1.0]), (-0.135, 0.0, 0.013))
THREADED = transform(t=(0.6, 0.05, 0.25))  # the ring's pose, its normal upwards


@cache
def hoop_arm() -> Robot:
    """The A465 without its gripper; the tool frame is that of the ring, in whose plane its handle is."""
    whole = load_a465(TOOL_LENGTH, 0.06)
    bare = replace(whole, bodies=tuple(body for body in whole.bodies if body.name not in HAND))
    handle = Body("handle", Box((0.08, 0.006, 0.0066)), transform(t=(-0.06, 0.0, 0.013)), "tool")
    return with_tool(bare, T_END_RING, [Body("ring", RING, T_END_RING, "tool"), handle])


def bar(offset: tuple[float, float] = (0.0, 0.0), pieces: int = 6, length: float = 0.2) -> list[Body]:
    """An upright bar through the ring at `THREADED`, `offset` m from its axis; its pieces overlap a little."""
    piece = length / pieces
    return [
        Body(
            f"bar {i}",
            Box((SIDE, SIDE, piece + 1e-3)),
            frozen(THREADED @ transform(t=(*offset, (i + 0.5) * piece - length / 2.0))),
            "wall",
        )
        for i in range(pieces)
    ]


def joints(T_base_ring: Array, near: Array | None = None) -> Array:
    """Joints (6,) at which the ring is there: the first found, or those nearest to others."""
    limits = load_unit("crs93").limits()
    found = inverse_kinematics(hoop_arm(), T_base_ring, limits.lower, limits.upper).q
    return found[0] if near is None else min(found, key=lambda q: float(np.abs(q - near).max()))


def along_bar(way: float, count: int = 20) -> Curve:
    """Straight joint motions that lead the ring by `way` m along its axis, half of it on each side of `THREADED`."""
    q = [joints(THREADED @ transform(t=(0.0, 0.0, -way / 2.0)))]
    for height in np.linspace(-way / 2.0, way / 2.0, count + 1)[1:]:
        q.append(joints(THREADED @ transform(t=(0.0, 0.0, float(height))), q[-1]))
    return curve_of_waypoints(np.array(q))


def threaded(bodies: list[Body], allowed: tuple[frozenset[str], ...] = ()) -> World:
    """The arm with its ring among the bodies, on a table."""
    return World(hoop_arm(), [TABLE, *bodies], allowed=allowed)


def as_capsules(torus: Body, count: int) -> list[Body]:
    """Capsules along a polygon that is as far outside of the circle as inside: by R (pi / count)^2 / 4."""
    shape, half_angle = torus.shape, np.pi / count
    assert isinstance(shape, Torus)
    corner = 2.0 * shape.radius / (1.0 + np.cos(half_angle))
    part = Capsule(shape.tube, 2.0 * corner * np.sin(half_angle))
    middle = transform(rot_x(np.pi / 2.0), (corner * np.cos(half_angle), 0.0, 0.0))
    turns = [transform(rot_z(2.0 * half_angle * i)) for i in range(count)]
    return [Body("part", part, frozen(torus.T_base_body @ turn @ middle), "tool") for turn in turns]


def motion(rng: np.random.Generator) -> Curve:
    """Two straight motions about a threaded configuration, from hardly moving to several centimetres."""
    size = float(rng.choice([0.003, 0.02, 0.08]))
    height = float(rng.uniform(-0.08, 0.08))
    q = joints(THREADED @ transform(rotation(rng.normal(size=3) * 0.1), (0.0, 0.0, height)))
    return curve_of_waypoints(q + size * rng.uniform(-1.0, 1.0, (3, 6)))


def sampled(world: World, curve: Curve, step: float = 0.002) -> float:
    """The smallest distance on a curve, m, at samples no joint moves further between than `step` rad."""
    way = float(np.abs(np.diff(curve.control, axis=1)).max() * 3.0)
    at = np.linspace(0.0, len(curve.control), int(np.ceil(len(curve.control) * way / step)) + 2)
    return min(world.distance(q).value for q in place(curve, at))
