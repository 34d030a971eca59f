"""Boards: a plate with two markers, and with four pockets ("holes") or none.

Board frame: origin at the centre of the lower-ID marker, x and y along the plate's edges, z out of the plate,
top surface at z = 0 (docs/sources.md, "Boards and cubes"). The second marker has the same rotation; on the plates that
the users' CSV files describe, it is at (180, 140) mm. A TOML file (`cell.config.plain_board`) has any other plate.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.errors import FileInputError
from arm.io.storage import read_text
from arm.se3 import Array, frozen, transform

PLATE_SIZE = (0.240, 0.200, 0.015)  # m
PLATE_CENTRE = (0.090, 0.070)  # centre of the top surface in the board frame, m
SECOND_MARKER = (0.180, 0.140)  # m
POCKET_MOUTH = 0.044  # m
POCKET_FLOOR = 0.039  # m
POCKET_DEPTH = 0.010  # m
QUIET_ZONE = 1.0 / 6.0  # width of a marker's white border in marker sizes
TOLERANCE_SDS = 2.0  # standard deviations in a tolerance
CUBE_SEAT_DEPTH = 0.008  # depth of a seated 40 mm cube below the top surface, m
CAPTURE_TILT = np.radians(2.0)
"""A released cube that leans further may not slide into its pocket, rad.

In contact physics 100 of 100 slide in at 2 degrees, 91 at 3 and 76 at 4 (bench/results/contact-2026-11-26.md).
"""


@dataclass(frozen=True)
class Plate:
    """A plate as a box, m.

    Attributes:
        size: (3,), along the board's x and y, and its thickness.
        centre: (2,), centre of its top in the board frame.
    """

    size: tuple[float, float, float] = PLATE_SIZE
    centre: tuple[float, float] = PLATE_CENTRE

    def edge_distances(self, points: Array) -> Array:
        """Return how far points (..., 2 or 3) of the board frame are from the plate's edges along x and y, (..., 2) m.

        Both are positive above the plate.
        """
        return np.array(self.size[:2]) / 2.0 - np.abs(np.asarray(points)[..., :2] - self.centre)

    @property
    def T_board_plate(self) -> Array:
        """Pose of the box's centre in the board frame."""
        return transform(t=(*self.centre, -self.size[2] / 2.0))


PLATE = Plate()
"""That of boards whose CSV file states none."""


@dataclass(frozen=True)
class Outline:
    """Outline of a plate's top, in the plane of the markers, where light turns to dark.

    Attributes:
        corners: (4, 2), clockwise seen from above, m in the board frame.
        tolerance: of each corner along x and along y, m: `TOLERANCE_SDS` standard deviations.
    """

    corners: tuple[tuple[float, float], ...]
    tolerance: float


def seat_depth(cube_size: float, pocket: tuple[float, float] = (POCKET_MOUTH, POCKET_FLOOR)) -> float:
    """Return the depth at which a cube of this edge wedges in a funnel-shaped pocket (mouth, floor), all in m."""
    mouth, floor = pocket
    return POCKET_DEPTH * (mouth - cube_size) / (mouth - floor)


@dataclass(frozen=True)
class Board:
    """A board as described by its file.

    Attributes:
        name: such as ``01-02``.
        marker_ids: lower and higher ID.
        holes: hole centres on the top surface, (4, 3) or (0, 3) m in the board frame.
        marker_size: edge of the black square, m.
        second_marker: centre of the second marker, relative to the first, m.
        tolerance: tolerance of the positions of markers and holes, m: `TOLERANCE_SDS` standard deviations.
        pocket: width of a pocket's mouth and of its floor, m.
        plate: its plate.
        outline: that of its top, if it may stand in for a hidden marker; else None.
    """

    name: str
    marker_ids: tuple[int, int]
    holes: Array
    marker_size: float
    second_marker: tuple[float, float] = SECOND_MARKER
    tolerance: float = 0.0
    pocket: tuple[float, float] = (POCKET_MOUTH, POCKET_FLOOR)
    plate: Plate = PLATE
    outline: Outline | None = None

    def marker_corners(self) -> Array:
        """Return the marker corners, (2, 4, 3) m in the board frame: top left, top right, bottom right, bottom left."""
        h = self.marker_size / 2.0
        square = np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])
        return frozen(np.stack([square, square + (*self.second_marker, 0.0)]))

    def T_board_hole(self, index: int) -> Array:
        """Return the pose of hole `index` (0 to 3): at its centre on the top surface, axes parallel to the board's."""
        return transform(t=self.holes[index])


def read_board_csv(path: Path, marker_size: float, tolerance: float = 0.0) -> Board:
    """Read a board file: a line with the two marker IDs, then four lines ``x,y`` in mm.

    The file has no header. Lines end with CRLF or LF; the last line end is optional.

    Args:
        path: the file, usually ``positions_plate_01-02.csv``.
        marker_size: edge of the black square, m.
        tolerance: see `Board`, m.

    Raises:
        FileInputError: a line breaks the format; the message quotes it.
    """
    lines = [line.strip() for line in read_text(path).splitlines()]
    while lines and not lines[-1]:
        lines.pop()
    if len(lines) != 5:
        why = f"has {len(lines)} lines; a board file has 5: the two marker ids, then x,y of four holes in mm"
        raise FileInputError(path, "", None, why, _no_row(lines))
    ids = _pair(path, 1, lines[0], "two marker ids such as 1,2")
    if not all(v == int(v) and 0 <= v <= 999 for v in ids) or ids[0] == ids[1]:
        why = "must be two different marker ids from 0 to 999, such as 1,2"
        raise FileInputError(path, "line 1", lines[0], why)
    holes = [
        _pair(path, number, line, "x,y of a hole in mm") for number, line in enumerate(lines[1:], start=2)
    ]
    fault = layout_fault(np.array(holes), marker_size)
    if fault is not None:
        line_index, rule = fault
        raise FileInputError(
            path, f"line {line_index + 2}", lines[line_index + 1], rule, _likely(np.array(holes), marker_size)
        )
    low, high = sorted(int(v) for v in ids)
    points = [(x / 1e3, y / 1e3, 0.0) for x, y in holes]
    return Board(f"{low:02d}-{high:02d}", (low, high), frozen(points), marker_size, tolerance=tolerance)


def layout_fault(
    holes_mm: Array,
    marker_size: float,
    plate: Plate = PLATE,
    second_marker: tuple[float, float] = SECOND_MARKER,
) -> tuple[int, str] | None:
    """Return the index of the first hole (of (4, 2)) that does not fit on the plate, and the broken rule; or None."""
    mouth = 1e3 * POCKET_MOUTH
    centre, room = 1e3 * np.array(plate.centre), 500.0 * np.array(plate.size[:2]) - mouth / 2.0
    apart = mouth / 2.0 + 1e3 * marker_size * (0.5 + QUIET_ZONE)
    for index, hole in enumerate(holes_mm):
        if not (np.abs(hole - centre) <= room).all():
            (x0, y0), (x1, y1) = centre - room, centre + room
            return index, (
                f"puts its mouth of {mouth:g} mm partly off the plate: x must be from {x0:g} to {x1:g} mm, y from "
                f"{y0:g} to {y1:g} mm"
            )
        for marker in (np.zeros(2), 1e3 * np.array(second_marker)):
            if np.abs(hole - marker).max() < apart:
                return index, (
                    f"lies on the marker at {marker[0]:g}, {marker[1]:g} mm or its white border: a hole's centre must "
                    f"be at least {apart:g} mm from that of a marker (of {1e3 * marker_size:g} mm) in x or in y"
                )
        for other in range(index):
            between = float(np.abs(hole - holes_mm[other]).max())
            if between < mouth:
                return index, (
                    f"is {between:.3g} mm from hole {other + 1}: mouths of {mouth:g} mm would overlap"
                )
    return None


def _likely(holes_mm: Array, marker_size: float) -> str:
    """Return a guess at what is wrong with the numbers (4, 2) of a board file."""
    second, centre = 1e3 * np.array(SECOND_MARKER), 1e3 * np.array(PLATE_CENTRE)
    corner = 500.0 * np.array(PLATE_SIZE[:2]) - centre
    readings = (
        (1e3 * holes_mm, "these are metres: multiply them by 1000"),
        (10.0 * holes_mm, "these are centimetres: multiply them by 10"),
        (holes_mm[:, ::-1], "x and y are swapped: x runs along the plate's long side, 240 mm"),
        (1e3 * holes_mm[:, ::-1], "these are metres, and x and y are swapped"),
        (25.4 * holes_mm, "these are inches: multiply them by 25.4"),
        (
            holes_mm * (1.0, -1.0),
            "y points down: it points up in the picture of the marker with the lower id",
        ),
        (
            holes_mm + second,
            f"these are from the marker with the higher id: add {second[0]:g} and {second[1]:g}",
        ),
        (holes_mm + centre, f"these are from the plate's centre: add {centre[0]:g} and {centre[1]:g}"),
        (holes_mm - corner, f"these are from the plate's corner: subtract {corner[0]:g} and {corner[1]:g}"),
    )
    for as_meant, words in readings:
        if layout_fault(as_meant, marker_size) is None:
            return f"it looks as if {words}"
    return "values are millimetres from the centre of the lower-ID marker"


def _no_row(lines: list[str]) -> str:
    """Say which line of a board file is none of its rows; "" if all may be."""
    for number, line in enumerate(lines, start=1):
        if not line:
            return f"line {number} is empty"
        if line.startswith(("#", "//")):
            return f"line {number} is a comment, and a board file has none"
        if any(character.isalpha() for character in line):
            return f"line {number} is {line[:40]!r}: a board file has no header and no words"
    return ""


def _pair_help(line: str) -> str:
    """Say what is often wrong in a line that is not two numbers; "" if nothing is known."""
    parts = line.split(",")
    if "," not in line:
        return "a comma stands between them"
    if '"' in line or "'" in line:
        return "numbers stand without quotation marks"
    if len(parts) > 2 and not any(part.strip() for part in parts[2:]):
        return "the commas at its end are those of empty cells: remove them"
    if any(character in line for character in ";\t"):
        return "the decimal sign is a point, and a comma stands between the two"
    if len(parts) > 2:
        return f"it has {len(parts)} values"
    words = "".join(line.replace("mm", "").split())
    return (
        "numbers stand without their unit"
        if words != line and all(c in "0123456789.,-" for c in words)
        else ""
    )


def _pair(path: Path, number: int, line: str, what: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in line.split(","))
    except ValueError:
        raise FileInputError(path, f"line {number}", line, f"must be {what}", _pair_help(line)) from None
    if not np.isfinite([first, second]).all():
        raise FileInputError(path, f"line {number}", line, f"must be {what}, finite")
    return first, second


def plate_name(board_name: str) -> str:
    """Return the name of a board's plate as a body."""
    return f"plate {board_name}"
