"""The boards: a plate with four pockets ("holes") and two markers, described by the users' CSV files.

Board frame: origin at the centre of the lower-ID marker, x and y along the plate's edges, z out of the plate,
top surface at z = 0 (fact sheet of the cell). The second marker is at (180, 140) mm, turned like the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.errors import FileInputError
from arm.files import read_text
from arm.se3 import Array, frozen, transform

PLATE_SIZE = (0.240, 0.200, 0.015)  # m
PLATE_CENTRE = (0.090, 0.070)  # of the top surface in the board frame, m
SECOND_MARKER = (0.180, 0.140)  # m
POCKET_MOUTH = 0.044  # m
POCKET_FLOOR = 0.039  # m
CUBE_SEAT_DEPTH = 0.008  # how deep a 40 mm cube wedges below the top surface, m


@dataclass(frozen=True)
class Board:
    """What a board's CSV says.

    Attributes:
        name: of the board, such as ``01-02``.
        marker_ids: lower and higher ID.
        holes: hole centres on the top surface, (4, 3) m in the board frame.
        marker_size: edge of the black square, m.
        second_marker: centre of the second marker, m from the first.
    """

    name: str
    marker_ids: tuple[int, int]
    holes: Array
    marker_size: float
    second_marker: tuple[float, float] = SECOND_MARKER

    def marker_corners(self) -> Array:
        """Corners of both markers, (2, 4, 3) m in the board frame: top left, top right, bottom right, bottom left."""
        h = self.marker_size / 2.0
        square = np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])
        return frozen(np.stack([square, square + (*self.second_marker, 0.0)]))

    def T_board_hole(self, index: int) -> Array:
        """Pose of hole `index` (0 to 3): at its centre on the top surface, turned like the board."""
        return transform(t=self.holes[index])


def read_board_csv(path: Path, marker_size: float) -> Board:
    """Read a board file as users have it: first line the two marker IDs, then four lines ``x,y`` in mm.

    No text header; CRLF or LF; the last line may lack its end.

    Args:
        path: the file, usually ``positions_plate_01-02.csv``.
        marker_size: edge of the black square, m.

    Raises:
        FileInputError: with the line that breaks the format.
    """
    lines = [line.strip() for line in read_text(path).splitlines()]
    while lines and not lines[-1]:
        lines.pop()
    if len(lines) != 5:
        raise FileInputError(
            path,
            "",
            None,
            f"has {len(lines)} lines; a board file has 5: the two marker ids, then x,y of four holes in mm",
        )
    ids = _pair(path, 1, lines[0], "two marker ids such as 1,2")
    if not all(v == int(v) and 0 <= v <= 999 for v in ids) or ids[0] == ids[1]:
        raise FileInputError(path, "line 1", lines[0], "must be two different whole marker ids such as 1,2")
    low_x, low_y = PLATE_CENTRE[0] - PLATE_SIZE[0] / 2, PLATE_CENTRE[1] - PLATE_SIZE[1] / 2
    holes = []
    for number, line in enumerate(lines[1:], start=2):
        x, y = (v / 1e3 for v in _pair(path, number, line, "x,y of a hole in mm"))
        if not (low_x <= x <= low_x + PLATE_SIZE[0] and low_y <= y <= low_y + PLATE_SIZE[1]):
            raise FileInputError(
                path,
                f"line {number}",
                line,
                f"is off the plate: x from {low_x * 1e3:g} to {(low_x + PLATE_SIZE[0]) * 1e3:g} mm, "
                f"y from {low_y * 1e3:g} to {(low_y + PLATE_SIZE[1]) * 1e3:g} mm",
                "values are millimetres from the centre of the lower-ID marker",
            )
        holes.append((x, y, 0.0))
    low, high = sorted(int(v) for v in ids)
    return Board(f"{low:02d}-{high:02d}", (low, high), frozen(holes), marker_size)


def _pair(path: Path, number: int, line: str, what: str) -> tuple[float, float]:
    try:
        first, second = (float(part) for part in line.split(","))
    except ValueError:
        raise FileInputError(path, f"line {number}", line, f"must be {what}") from None
    if not np.isfinite([first, second]).all():
        raise FileInputError(path, f"line {number}", line, f"must be {what}, finite")
    return first, second
