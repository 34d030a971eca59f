"""Curves of the tool over the table, and what may stand beside them."""

from __future__ import annotations

import numpy as np

from arm.robot.shapes import Body, Box, Cylinder
from arm.se3 import Array, frozen, rot_z, rotation, transform
from plan.curve.tool_curve import ToolCurve
from plan.kinematics.freedom import Freedom
from tasks.pose_lists import down

TURNED = transform(rot_z(1.0))  # with this turn of the tool, J6 is far from its limits
START, END = (0.42, -0.1, 0.12), (0.42, 0.12, 0.12)
LINE = frozen(np.stack([down(*at) @ TURNED for at in (START, END)]))
CLEARANCE = 0.005
# beside the line: with the tool upright the hub is too near to it, tilted it is not
POST = Body("post", Cylinder(0.01, 0.3), transform(t=(0.46, 0.02, 0.1)), "post")
# across the line, from the table to above the hand
PLATE = Body("plate", Box((0.2, 0.01, 0.3)), transform(t=(0.45, 0.02, 0.15)), "plate")


def arc(radius: float = 0.06, angle: float = np.pi, count: int = 25) -> Array:
    """Poses (count, 4, 4) along an arc over the table; the tool points down and keeps its turn."""
    around = np.linspace(0.0, angle, count)
    places = [(0.42 + radius * np.cos(a), 0.1 + radius * np.sin(a), 0.12) for a in around]
    return frozen(np.stack([down(*place) @ TURNED for place in places]))


def some_curve(
    rng: np.random.Generator, freedom: Freedom | None = None, free: tuple[str, ...] = ()
) -> ToolCurve:
    """A curve of 3 to 6 poses that go on in x, and turn from pose to pose by at most 0.5 rad."""
    count = int(rng.integers(3, 7))
    steps = rng.uniform((0.01, -0.03, -0.03), (0.04, 0.03, 0.03), (count, 3))
    poses = []
    R = rotation(rng.uniform(-1.0, 1.0, 3))
    for at in np.cumsum(steps, axis=0):
        R = R @ rotation(rng.uniform(-0.28, 0.28, 3))
        poses.append(transform(R, at))
    return ToolCurve(frozen(np.stack(poses)), freedom or Freedom({}), free)


def some_coordinates(rng: np.random.Generator, curve: ToolCurve, count: int) -> Array:
    """Coordinates (count, 6) of what is free on a curve, uniform within its limits."""
    low, high = (np.clip(side, -np.pi, np.pi) for side in curve.box())
    found = rng.uniform(low, high, (count, 6))
    tilt = curve.freedom.tilt
    if tilt > 0.0:
        size, angle = tilt * np.sqrt(rng.random(count)), rng.uniform(0.0, 2.0 * np.pi, count)
        found[:, 3], found[:, 4] = size * np.cos(angle), size * np.sin(angle)
    return found
