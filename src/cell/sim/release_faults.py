"""Faults of the simulated cell when the jaws release a cube over a hole."""

from __future__ import annotations

import numpy as np

from arm.board import CUBE_SEAT_DEPTH
from arm.se3 import Array, frozen, rot_x, rot_z, transform
from cell.scene.bodies import T_hole_cube

HIGH = 4e-3  # height above a seated cube, m
HALF_TILT = np.radians(8.0)  # tilt with one side in its seat and the other up
ASIDE = 25e-3  # distance from the hole, on the plate, m
PUSH = (0.010, -0.0066, 0.0)  # shift of the board with its cubes, 12 mm, in m


def T_hole_released(release: str, cube_size: float, depth: float = CUBE_SEAT_DEPTH) -> Array:
    """Final pose of a released cube in the frame of its hole.

    Args:
        release: one of `cell.files.world.RELEASES`: ``seated``; ``high``: upright, but 4 mm too high;
            ``half``: tilted, one side in its seat and the other up; ``rim``: flat on the plate over the
            mouth, rotated; ``aside``: on the plate 25 mm beside the hole; ``pushed``: seated, but the board
            with its cubes was pushed by 12 mm.
        cube_size: edge, m.
        depth: of a seated one below the plate's top, m.
    """
    seated, half = T_hole_cube(cube_size, depth), cube_size / 2.0
    if release == "high":
        return frozen(transform(t=(0.0, 0.0, HIGH)) @ seated)
    if release == "half":  # rotated about the seated edge
        edge = transform(t=(0.0, half, -depth))
        return frozen(edge @ transform(rot_x(-HALF_TILT)) @ transform(t=(0.0, -half, half)))
    if release == "rim":
        return frozen(transform(rot_z(np.pi / 4.0), (0.0, 0.0, half)))
    if release == "aside":
        return frozen(transform(t=(ASIDE, 0.0, half)))
    return seated
