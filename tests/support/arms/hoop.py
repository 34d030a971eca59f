"""A ring at the flange of the A465, and a square bar through it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from arm.controller.unit import load_unit
from arm.robot.gripper import HAND
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Box, Torus
from arm.robot.tool import with_tool
from arm.se3 import Array, frozen, transform
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
