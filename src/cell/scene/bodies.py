"""Bodies of a board: its plate, its stand, and cubes in its holes.

The planner builds them from observations, and the simulated cell from ground truth.
"""

from __future__ import annotations

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, PLATE, Plate, plate_name
from arm.numerics.angles import arctan2
from arm.numerics.products import mul
from arm.robot.shapes import Body, Box
from arm.se3 import Array, apply, frozen, transform


def plate_body(board_name: str, T_base_board: Array, plate: Plate = PLATE) -> Body:
    """The plate as a solid box without pockets. So a cube in a pocket needs an allowed collision."""
    T_base_plate = frozen(mul(T_base_board, plate.T_board_plate))
    return Body(plate_name(board_name), Box(plate.size), T_base_plate, "board")


def stand_body(
    board_name: str,
    T_base_board: Array,
    footprint: tuple[float, float],
    table_z: float,
    padding: float = 0.0,
    plate: Plate = PLATE,
) -> Body | None:
    """The stand as an upright box from the table to the plate's underside, or None if there is no room for one.

    Real stands are wedges. The box ends at the lowest point of the underside above its footprint, so it stays below the
    plate. Its top is lowered by the padding, which otherwise would reach through the plate. No body of the arm fits
    into the resulting gap.
    """
    half_x, half_y = footprint[0] / 2.0, footprint[1] / 2.0
    (cx, cy), under = plate.centre, -plate.size[2]
    corners = [(cx + i * half_x, cy + j * half_y, under) for i in (-1, 1) for j in (-1, 1)]
    top = float(apply(T_base_board, corners)[:, 2].min()) - 1e-3 - padding
    if top - table_z < 2e-3:
        return None
    x, y, _ = apply(T_base_board, (cx, cy, under))
    yaw = float(arctan2(T_base_board[1, 0], T_base_board[0, 0]))
    c, s = np.cos(yaw), np.sin(yaw)
    pose = transform([[c, -s, 0], [s, c, 0], [0, 0, 1]], (x, y, (top + table_z) / 2.0))
    box = Box((footprint[0], footprint[1], top - table_z))
    return Body(f"stand {board_name}", box, pose, "stand", padding)


def T_hole_cube(cube_size: float, depth: float = CUBE_SEAT_DEPTH) -> Array:
    """Pose of a seated cube: centred in its hole, wedged to the seat depth, m."""
    return transform(t=(0.0, 0.0, cube_size / 2.0 - depth))


def cube_body(name: str, size: float, T_base_cube: Array) -> Body:
    """A cube at a pose of its centre."""
    return Body(name, Box((size, size, size)), frozen(T_base_cube), "cube")
