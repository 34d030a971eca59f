"""What became of a cube that rests: seated in a pocket, beside it, on the table, or elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from arm.board import seat_depth
from arm.numerics.products import mul
from arm.se3 import Array, apply, inverse
from cell.files.world import TrueBoard

SEATED = 5e-4  # m: each corner of a seated cube's bottom is this near to its depth
ON_TABLE = 1e-3  # m, largest height of the corners of a cube that stands on the table
_CORNERS = np.array(list(product((-0.5, 0.5), repeat=3)))


@dataclass(frozen=True)
class Resting:
    """How a cube rests.

    Attributes:
        what: the event of a cube released there: placed, unseated, set down or fallen.
        where: pocket, table or fallen, as of `cell.sim.cubes.SimulatedCube`.
        place: name of the hole in or beside which it is, or empty.
        detail: one phrase.
    """

    what: str
    where: str
    place: str
    detail: str


def resting(T_base_cube: Array, size: float, boards: Sequence[TrueBoard], table_z: float) -> Resting:
    """How a cube of edge `size` m rests.

    It is seated if each corner of its bottom is within `SEATED` of the depth at which it wedges. As the funnel is
    steep, that leaves it 0.13 mm sideways and 1 degree of tilt.
    """
    corners = size * _CORNERS
    for b in boards:
        T_board_cube = mul(inverse(b.T_base_board), T_base_cube)
        centre = T_board_cube[:3, 3]
        if (b.board.plate.edge_distances(centre) < 0.0).any() or not -size < centre[2] < 2.0 * size:
            continue
        hole = int(np.argmin(np.abs(b.board.holes[:, :2] - centre[:2]).max(axis=1)))
        aside = float(np.abs(b.board.holes[hole, :2] - centre[:2]).max())
        bottom = np.sort(apply(T_board_cube, corners)[:, 2])[:4]
        high = bottom + seat_depth(size, b.board.pocket)
        name = f"{b.board.name}/{hole + 1}"
        tilt = np.degrees(np.arccos(np.clip(np.abs(T_board_cube[2, :3]).max(), -1.0, 1.0)))
        detail = f"{1e3 * aside:.2f} mm off the axis of {name}, its bottom {1e3 * high.min():.2f} to "
        detail += f"{1e3 * high.max():.2f} mm above its seat, tilted by {tilt:.1f} deg"
        if np.abs(high).max() <= SEATED:
            return Resting("placed", "pocket", name, detail)
        return Resting("unseated", "pocket", name, detail)
    heights = apply(T_base_cube, corners)[:, 2] - table_z
    if np.abs(np.sort(heights)[:4]).max() <= ON_TABLE:
        return Resting("set down", "table", "", "on the table")
    return Resting("fallen", "fallen", "", f"{1e3 * heights.min():.0f} mm above the table, over no plate")
