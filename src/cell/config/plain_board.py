"""Board files of either kind: a CSV of holes on the plate of `arm.board`, a TOML of any plate, with holes or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm.board import POCKET_DEPTH, Board, Outline, Plate, layout_fault, read_board_csv
from arm.io.keys import Keys, key
from arm.io.node import Node
from arm.io.rules import integers, number, numbers, triple
from arm.se3 import Array, frozen

_APART = 1.05  # least distance of the markers' centres, in marker sizes, along x or y
_OFF = 5e-3  # largest distance of a measured corner of the outline from that of the plate, along x and y, m


class PlainBoardKeys(Keys):
    """Keys of the file of a board of any size."""

    markers: tuple[int, ...] = key("markers", integers(2, 0, 999))
    marker_size: float = key("marker_size_mm", number("mm", 5, 200))
    second: Array = key("second_marker_mm", numbers(2, "mm", -1000, 1000))
    size: tuple[float, float, float] = key("size_mm", triple("mm", 1, 2000))
    centre: Array = key("centre_mm", numbers(2, "mm", -1000, 1000))
    holes: Array | None = key("holes_mm", numbers((4, 2), "mm", -1000, 1000), None)
    made_within: float | None = key("made_within_mm", number("mm", 0, 5), None)
    outline: Array | None = key("outline_mm", numbers((4, 2), "mm", -1000, 1000), None)
    outline_within: float | None = key("outline_within_mm", number("mm", 0.01, 5), None)


def read_board(path: Path, marker_size: float, tolerance: float = 0.0) -> Board:
    """Read a board file.

    Args:
        path: the file; one that ends with ``.toml`` states its plate, and may have holes.
        marker_size: edge of the black squares of a board whose file is a CSV, m.
        tolerance: manufacturing tolerance if the file states none, m; see `arm.board.Board`.

    Raises:
        FileInputError: a value is wrong; names file, key or line, value and rule.
    """
    if path.suffix != ".toml":
        return read_board_csv(path, marker_size, tolerance)
    root = Node.of_toml(path, "board")
    keys = PlainBoardKeys.read(root)
    low, high = keys.markers
    if low >= high:
        raise root.error_at("markers", "must be two different ids, the lower one first")
    if np.abs(keys.second).max() < _APART * keys.marker_size:
        rule = f"must be at least {1e3 * _APART * keys.marker_size:g} mm in x or y: markers must not touch"
        raise root.error_at("second_marker_mm", rule)
    x, y, thickness = keys.size
    room = np.array([x, y]) / 2.0 - keys.marker_size / 2.0
    for at, name in ((np.zeros(2), "centre_mm"), (keys.second, "second_marker_mm")):
        if (np.abs(at - keys.centre) > room + 1e-9).any():
            raise root.error_at(name, "puts a marker partly off the board, which is centred at centre_mm")
    plate = Plate((x, y, thickness), (float(keys.centre[0]), float(keys.centre[1])))
    second = float(keys.second[0]), float(keys.second[1])
    return Board(
        f"{low:02d}-{high:02d}",
        (low, high),
        _holes(keys, root, plate, second),
        keys.marker_size,
        second,
        tolerance if keys.made_within is None else keys.made_within,
        plate=plate,
        outline=_outline(keys, root),
    )


def _holes(keys: PlainBoardKeys, root: Node, plate: Plate, second: tuple[float, float]) -> Array:
    """Return the holes' centres, (4, 3) or (0, 3) m."""
    if keys.holes is None:
        return frozen(np.zeros((0, 3)))
    if plate.size[2] <= POCKET_DEPTH:
        raise root.error_at(
            "size_mm", f"must be thicker than its pockets, which are {1e3 * POCKET_DEPTH:g} mm deep"
        )
    fault = layout_fault(1e3 * keys.holes, keys.marker_size, plate, second)
    if fault is not None:
        raise root["holes_mm"].items()[fault[0]].error(fault[1])
    return frozen(np.pad(keys.holes, ((0, 0), (0, 1))))


def _outline(keys: PlainBoardKeys, root: Node) -> Outline | None:
    """Return the outline that may stand in for a hidden marker, if the file allows it."""
    if keys.outline_within is None:
        if keys.outline is not None:
            raise root.error_at("outline_mm", "needs outline_within_mm: how exactly its corners are known")
        return None
    half = np.array(keys.size[:2]) / 2.0
    plate = keys.centre + half * np.array([(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)])
    corners = plate if keys.outline is None else keys.outline
    if np.abs(corners - plate).max() > _OFF:
        rule = (
            "must be the plate's corners as measured, each within 5 mm of that of size_mm and centre_mm: top left, top "
            "right, bottom right, bottom left, in marker 1's picture"
        )
        raise root.error_at("outline_mm", rule)
    return Outline(tuple((float(x), float(y)) for x, y in corners), keys.outline_within)
