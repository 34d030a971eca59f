"""Values of a cell file that are rather in another unit, or measured from another place, by their size alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arm.robot.shapes import Box
from cell.config.cell import Cell

_ABOVE_TABLE = 0.1  # m, of the lower side of the zone for boards; a board stands on the table
_LEAST_TURN = 0.05  # deg, below which boards differ from look to look anyway
_LEAST_REGISTER = 0.1  # of the unit's default: a tenth of the speed is what --speed is for
_MIRRORED = 0.01  # m by which a wall of the other sign may miss the table's top
_LEAST_MM = {  # by key, what is less is rather in metres
    "tool.grip_height_mm": 0.5,
    "table.top_z_mm": 0.5,
    "arm_padding_mm": 0.5,
}


def scale_doubts(cell: Cell) -> Iterator[str]:
    """Say which values are doubtful, each with its key."""
    for name, least in _LEAST_MM.items():
        value = cell.inputs.get(name)
        if isinstance(value, int | float) and 0.0 < abs(value) < least:
            yield f"{name} = {value:g}: is it in metres? Then it must be {1e3 * value:g} in mm"
    turn = cell.inputs.get("look.moved_deg")
    if isinstance(turn, int | float) and turn < _LEAST_TURN:
        yield (
            f"look.moved_deg = {turn:g}: is it in rad? Then it must be {np.degrees(turn):.3g} in deg; as it is, a "
            "board counts as moved by what looks differ anyway, and the rest is replanned each time"
        )
    yield from _slow(cell)
    yield from _zone(cell)
    yield from _mirrored(cell)


def _slow(cell: Cell) -> Iterator[str]:
    """Say which registers are far below the unit's, such as a speed in deg/s."""
    for name, found, usual in (
        ("speed_registers", cell.speed_registers, cell.unit.speed_registers),
        ("acceleration_registers", cell.acceleration_registers, cell.unit.acceleration_registers),
    ):
        low = [k for k in range(6) if found[k] < _LEAST_REGISTER * usual[k]]
        if low:
            k = low[0]
            share = 100.0 * found[k] / usual[k]
            yield (
                f"motion.{name}: J{k + 1} has {found[k]}, {share:.2g} % of the usual {usual[k]}: "
                "are these deg/s or deg/s^2? Registers are 1/256 count per ms or ms^2; motion.speed slows the arm"
            )


def _zone(cell: Cell) -> Iterator[str]:
    """Say that no board fits in the zone, that the arm stands in it, or that it is far above the table."""
    if not isinstance(cell.zone.shape, Box):
        return
    size, centre = np.array(cell.zone.shape.size), cell.zone.T_base_body[:3, 3]
    plates = [sorted(board.plate.size[:2]) for board in cell.boards]
    if plates and all((np.sort(size[:2]) < plate).any() for plate in plates):
        yield (
            f"boards.zone_size_mm = [{_mm(size)}]: no board fits in it: is it in cm? Then it must be "
            f"[{_mm(10.0 * size)}]"
        )
    if (np.abs(centre[:2]) < size[:2] / 2.0).all():
        yield (
            f"boards.zone_centre_mm = [{_mm(centre)}]: the arm's base is in the zone for boards: is its place or "
            "size in another unit?"
        )
    above = float(centre[2] - size[2] / 2.0 - cell.table_z)
    if above > _ABOVE_TABLE:
        yield (
            f"boards.zone_centre_mm and table.top_z_mm: the zone for boards begins {1e3 * above:.0f} mm above the "
            "table's top, and no board stands in the air: are both heights measured from the arm's mounting plane?"
        )


def _mirrored(cell: Cell) -> Iterator[str]:
    """Say which wall would stand on the table if its height had the other sign."""
    for number, wall in enumerate(cell.walls):
        if isinstance(wall.shape, Box):
            z, half = float(wall.T_base_body[2, 3]), wall.shape.size[2] / 2.0
            if z < cell.table_z - half / 2.0 and abs(-z - half - cell.table_z) < _MIRRORED:
                yield (
                    f"walls[{number}] ({wall.name}): it is below the table's top, and would stand on it with "
                    f"centre_mm[2] = {-1e3 * z:g}: is the sign wrong? z points up"
                )


def _mm(lengths: np.typing.NDArray[np.float64]) -> str:
    return ", ".join(f"{1e3 * v:.6g}" for v in lengths.tolist())
