"""Keys of the cell file about boards: tilts of the stands, pockets, and the accuracy that a pose needs."""

from __future__ import annotations

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, POCKET_FLOOR, POCKET_MOUTH, seat_depth
from arm.io.toml_reader import TomlTable
from vision.boards.checks import BoardLimits

LEAST_FUNNEL = 1e-3  # least difference between the widths of mouth and floor, m
SEAT_TOLERANCE = 1e-3  # largest deviation of a cube's depth from `CUBE_SEAT_DEPTH`, m

DICTIONARIES = (
    *(f"DICT_{side}X{side}_{count}" for side in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    "DICT_ARUCO_ORIGINAL",
    "DICT_ARUCO_MIP_36h12",
    "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h10",
    "DICT_APRILTAG_36h11",
)
"""OpenCV's dictionaries, listed here so that reading a cell file does not load OpenCV."""


def read_tilts(boards: TomlTable) -> tuple[float, ...]:
    """Return ``tilts_deg`` of ``[boards]`` in rad, ascending; empty without the key.

    Raises:
        FileInputError: the values are not distinct numbers from 0 to 45.
    """
    if "tilts_deg" not in boards:
        return ()
    values = boards.value("tilts_deg", "a list of angles in deg")
    good = isinstance(values, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) and 0.0 <= v <= 45.0 for v in values
    )
    if not good or len(set(values)) < len(values):
        raise boards.error(
            "tilts_deg", "must be a list of different angles from 0 to 45 deg, such as [0, 7, 15]"
        )
    return tuple(float(np.radians(v)) for v in sorted(values))


def read_pocket(boards: TomlTable, cube: TomlTable, cube_size: float) -> tuple[float, float]:
    """Return ``pocket_mm`` of ``[boards]``: widths of mouth and floor, m.

    Args:
        boards: table ``[boards]``.
        cube: table ``[cube]``, for messages.
        cube_size: edge of the cubes, m.

    Raises:
        FileInputError: the pocket is no funnel, or a cube does not wedge in it at the depth that detection and
            planning assume.
    """
    mouth, floor = POCKET_MOUTH, POCKET_FLOOR
    if "pocket_mm" in boards:
        mouth, floor = (float(v) for v in boards.numbers("pocket_mm", 2, "mm", 5, 60) / 1e3)
    if not mouth - floor >= LEAST_FUNNEL:
        raise boards.error("pocket_mm", "must be the widths of mouth and floor, the floor at least 1 mm less")
    shape = f"pockets are {1e3 * mouth:g} mm wide at the mouth and {1e3 * floor:g} mm at the floor (boards.pocket_mm)"
    if cube_size > mouth:
        raise cube.error("size_mm", f"must fit the pocket, but is wider than its mouth: {shape}")
    if cube_size < floor:
        raise cube.error("size_mm", f"must fit the pocket, but would lie loose on its floor: {shape}")
    depth = seat_depth(cube_size, (mouth, floor))
    if abs(depth - CUBE_SEAT_DEPTH) > SEAT_TOLERANCE:
        raise cube.error(
            "size_mm",
            f"must wedge in the pocket {1e3 * CUBE_SEAT_DEPTH:g} mm deep within {1e3 * SEAT_TOLERANCE:g} mm, but would "
            f"wedge {1e3 * depth:.1f} mm deep: {shape}",
        )
    return mouth, floor


def read_board_limits(look: TomlTable) -> BoardLimits:
    """Read ``least_certain_mm``, ``least_certain_height_mm`` and ``least_certain_deg`` of ``[look]``.

    Raises:
        FileInputError: a value is out of range.
    """
    default = BoardLimits()
    sideways = look.number("least_certain_mm", "mm", 0.01, 10, default=1e3 * default.sideways_m)
    height = look.number("least_certain_height_mm", "mm", 0.01, 20, default=1e3 * default.height_m)
    turn = look.number("least_certain_deg", "deg", 0.01, 10, default=float(np.degrees(default.turn_rad)))
    return BoardLimits(sideways_m=sideways / 1e3, height_m=height / 1e3, turn_rad=float(np.radians(turn)))
