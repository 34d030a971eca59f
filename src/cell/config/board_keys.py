"""Keys of the cell file about boards: their files, pockets, stands, zone, and the accuracy that a pose needs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, POCKET_FLOOR, POCKET_MOUTH, Board, seat_depth
from arm.errors import FileInputError
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import is_number, number, numbers, rule_of, same, standing, text, triple, zero_or
from arm.io.slips.names import no_file
from arm.se3 import Array
from cell.config.plain_board import read_board
from vision.boards.checks import BoardLimits

LEAST_FUNNEL = 1e-3  # smallest difference between the widths of mouth and floor, m
SEAT_TOLERANCE = 1e-3  # largest deviation of a cube's depth from `CUBE_SEAT_DEPTH`, m
MADE_WITHIN_MM = 0.1  # default manufacturing tolerance of boards

DICTIONARIES = {
    **{f"DICT_{side}X{side}_{count}": count for side in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    **{"DICT_ARUCO_ORIGINAL": 1024, "DICT_ARUCO_MIP_36h12": 250},
    **{"DICT_APRILTAG_16h5": 30, "DICT_APRILTAG_25h9": 35},
    **{"DICT_APRILTAG_36h10": 2320, "DICT_APRILTAG_36h11": 587},
}
"""OpenCV's dictionaries and how many markers each has, listed here so that reading a cell file does not load OpenCV."""
DICTIONARY = Rule("one of OpenCV's dictionaries", text(*DICTIONARIES).read)
_LIMITS = BoardLimits()
APART_DEG = 0.5  # of two tilts: nearer ones cannot be told apart
_TILTS = f"a list of angles from 0 to 45 deg that differ by {APART_DEG:g} deg or more, such as [0, 7, 15]"


def _are_names(values: Any) -> bool:
    return isinstance(values, list) and bool(values) and all(isinstance(one, str) for one in values)


def _are_tilts(values: Any) -> bool:
    good = isinstance(values, list) and all(is_number(v) and 0.0 <= v <= 45.0 for v in values)
    return good and bool(np.all(np.diff(sorted(values)) >= APART_DEG))


class BoardKeys(Keys):
    """Keys of ``[boards]``, and of ``[look]`` about the accuracy of a board's pose."""

    board_files: list[str] = key("boards.files", rule_of("a list of board files", _are_names, list))
    marker_size: float = key("boards.marker_size_mm", number("mm", 5, 200))
    pocket: Array = key("boards.pocket_mm", numbers(2, "mm", 5, 60), (1e3 * POCKET_MOUTH, 1e3 * POCKET_FLOOR))
    made_within: float = key("boards.made_within_mm", zero_or(0.002, 2), MADE_WITHIN_MM)
    tilts_deg: list[float] = key("boards.tilts_deg", rule_of(_TILTS, _are_tilts, same), [])
    stand_size: Array = key("boards.stand_size_mm", numbers(2, "mm", 10, 240))
    zone_centre: Array = key("boards.zone_centre_mm", standing(3, -5000, 5000))
    zone_size: tuple[float, float, float] = key("boards.zone_size_mm", triple("mm", 1, 10000))
    sideways: float = key("look.least_certain_mm", number("mm", 0.01, 10), 1e3 * _LIMITS.sideways_m)
    height: float = key(
        "look.least_certain_height_mm", number("mm", 0.01, 20), default=1e3 * _LIMITS.height_m
    )
    turn: float = key(
        "look.least_certain_deg", number("deg", 0.01, 10), default=float(np.degrees(_LIMITS.turn_rad))
    )


def boards_of(keys: BoardKeys, root: Node, cube_size: float) -> tuple[Board, ...]:
    """Read the boards' files.

    Args:
        keys: keys of the cell file.
        root: the cell file, for messages.
        cube_size: edge of the cubes, m.

    Raises:
        InputError: a file is missing or wrong, two boards share a marker, the pocket is no funnel, or a cube does not
            wedge in it at the depth that detection and planning assume.
    """
    pocket = _pocket(keys, root, cube_size)
    boards: list[Board] = []
    for name in keys.board_files:
        path = root.file.parent / name
        if not path.is_file():
            raise root.error_at("boards.files", *no_file(path, root.file))
        board = replace(read_board(path, keys.marker_size, keys.made_within), pocket=pocket)
        dictionary = root["boards"]["dictionary"].read(DICTIONARY)
        most = DICTIONARIES[dictionary] - 1
        if (last := board.marker_ids[1]) > most:
            rule = f"must be from 0 to {most} in {dictionary}, the cell file's boards.dictionary"
            raise FileInputError(path, "marker id", last, rule)
        for other, file in zip(boards, keys.board_files, strict=False):
            if taken := sorted(set(other.marker_ids) & set(board.marker_ids)):
                markers = " and ".join(map(str, taken))
                rule = f"must not have the same markers: {file} and {name} both have {markers}"
                raise root.error_at("boards.files", rule)
        boards.append(board)
    return tuple(boards)


def _pocket(keys: BoardKeys, root: Node, cube_size: float) -> tuple[float, float]:
    """Return the widths of mouth and floor, m."""
    mouth, floor = keys.pocket.tolist()
    if not mouth - floor >= LEAST_FUNNEL:
        rule = "must be the widths of mouth and floor, the floor at least 1 mm less"
        raise root.error_at("boards.pocket_mm", rule)
    depth = seat_depth(cube_size, (mouth, floor))
    if cube_size > mouth:
        rule = "must fit the pocket, but is wider than its mouth"
    elif cube_size < floor:
        rule = "must fit the pocket, but would lie loose on its floor"
    elif abs(depth - CUBE_SEAT_DEPTH) > SEAT_TOLERANCE:
        least, most = 1e3 * (CUBE_SEAT_DEPTH - SEAT_TOLERANCE), 1e3 * (CUBE_SEAT_DEPTH + SEAT_TOLERANCE)
        rule = f"must sit between {least:g} and {most:g} mm deep in the pocket, but would sit {1e3 * depth:.1f} mm deep"
    else:
        return mouth, floor
    shape = f"pockets are {1e3 * mouth:g} mm wide at the mouth and {1e3 * floor:g} mm at the floor (boards.pocket_mm)"
    raise root.error_at("cube.size_mm", f"{rule}: {shape}")
