"""What the cell file says of looking at boards: tilts of the stands, and how certain a pose must be."""

from __future__ import annotations

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, POCKET_FLOOR, POCKET_MOUTH, seat_depth
from arm.io.toml_reader import TomlTable
from vision.boards.checks import BoardLimits

LEAST_FUNNEL = 1e-3  # m between the widths of a mouth and of a floor
SEAT_TOLERANCE = 1e-3  # m by which a cube may sit deeper or less deep than looks and plans take for granted

DICTIONARIES = (
    *(f"DICT_{side}X{side}_{count}" for side in (4, 5, 6, 7) for count in (50, 100, 250, 1000)),
    "DICT_ARUCO_ORIGINAL",
    "DICT_ARUCO_MIP_36h12",
    "DICT_APRILTAG_16h5",
    "DICT_APRILTAG_25h9",
    "DICT_APRILTAG_36h10",
    "DICT_APRILTAG_36h11",
)
"""OpenCV's; written out, because reading a cell file need not load OpenCV."""


def read_tilts(boards: TomlTable) -> tuple[float, ...]:
    """``tilts_deg`` of ``[boards]`` in rad, ascending; none if the key is not there.

    Raises:
        FileInputError: not different numbers from 0 to 45.
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
    """``pocket_mm`` of ``[boards]``, widths of mouth and floor in m, into which a cube of `cube_size` m must fit.

    Raises:
        FileInputError: no funnel, or the cube does not wedge in it as deep as looks and plans take for granted.
    """
    mouth, floor = POCKET_MOUTH, POCKET_FLOOR
    if "pocket_mm" in boards:
        mouth, floor = (float(v) for v in boards.numbers("pocket_mm", 2, "mm", 5, 60) / 1e3)
    if not mouth - floor >= LEAST_FUNNEL:
        raise boards.error("pocket_mm", "must be the mouth's width and the floor's, at least 1 mm less")
    shape = f"pockets are {1e3 * mouth:g} mm wide at the mouth and {1e3 * floor:g} mm at the floor (boards.pocket_mm)"
    if cube_size > mouth:
        raise cube.error("size_mm", f"must fit its pocket, and does not go into the mouth: {shape}")
    if cube_size < floor:
        raise cube.error("size_mm", f"must fit its pocket, and would lie loose on the floor: {shape}")
    depth = seat_depth(cube_size, (mouth, floor))
    if abs(depth - CUBE_SEAT_DEPTH) > SEAT_TOLERANCE:
        raise cube.error(
            "size_mm",
            f"must fit its pocket {1e3 * CUBE_SEAT_DEPTH:g} mm deep, to {1e3 * SEAT_TOLERANCE:g} mm, and would wedge "
            f"{1e3 * depth:.1f} mm deep: {shape}",
        )
    return mouth, floor


def read_board_limits(look: TomlTable) -> BoardLimits:
    """``least_certain_mm``, ``least_certain_height_mm`` and ``least_certain_deg`` of ``[look]``.

    Raises:
        FileInputError: a value breaks its rule.
    """
    default = BoardLimits()
    sideways = look.number("least_certain_mm", "mm", 0.01, 10, default=1e3 * default.sideways_m)
    height = look.number("least_certain_height_mm", "mm", 0.01, 20, default=1e3 * default.height_m)
    turn = look.number("least_certain_deg", "deg", 0.01, 10, default=float(np.degrees(default.turn_rad)))
    return BoardLimits(sideways_m=sideways / 1e3, height_m=height / 1e3, turn_rad=float(np.radians(turn)))
