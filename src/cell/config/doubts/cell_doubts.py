"""What of a cell file is rather meant in another unit or place: each would be planned with, and be wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from arm.board import CUBE_SEAT_DEPTH
from arm.robot.gripper import Gripper
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from cell.config.cell import Cell
from cell.config.doubts.angles import doubt_of_deg
from cell.config.doubts.camera_doubts import camera_doubts
from cell.config.doubts.scale_doubts import scale_doubts
from cell.config.doubts.unit_doubts import unit_doubts
from plan.collision.world import distance_of

_THIN_STAND, _THIN = 0.025, 0.01  # m; below these, what is meant is rather in cm
_TALL = 0.1  # m; a wall that is lower may be sunk into the table
_IN_BASE = 0.02  # m by which the base may be in a wall, such as a pedestal
_HIGH = 5e-4  # m; a grip height that is less is rather in metres
_BESIDE = 0.001  # m by which the zone for boards may reach beyond the table


def cell_doubts(cell: Cell) -> tuple[str, ...]:
    """Say which values may be in another unit or place, each with its file and key."""
    doubt = doubt_of_deg(cell.q_start, cell.unit)
    found = [f"q_start_deg = {doubt}"] if doubt else []
    found.extend(_sunk(cell))
    found.extend(_beyond_table(cell))
    found.extend(enclosing(cell).values())
    found.extend(camera_doubts(cell))
    found.extend(scale_doubts(cell))
    found.extend(unit_doubts(cell.nominal_unit))
    small = _small(cell)
    if "tool.finger_mm" not in small:
        found.extend(_short_fingers(cell))
    for name, sizes in small.items():
        stated, meant = (", ".join(f"{unit * v:.6g}" for v in sizes) for unit in (1e3, 1e4))
        found.append(
            f"{name} = [{stated}]: is it in cm? Then it must be [{meant}] in mm; as it is, clearances are those of a "
            "body that is this small"
        )
    return tuple(f"{cell.file.name}: {words}" for words in found)


def enclosing(cell: Cell) -> dict[str, str]:
    """Say by its name of each wall that the arm's base is in it."""
    return around_base(cell.nominal_robot(), cell.walls, "walls")


def around_base(robot: Robot, bodies: Sequence[Body], key: str) -> dict[str, str]:
    """Say by its name of each body that the arm's base is in it; `key`: of these bodies in the file."""
    base = [
        Body(body.name, body.shape, body.T_joint_body, "robot") for body in robot.bodies if body.joint == 0
    ]
    found = {}
    for number, wall in enumerate(bodies):
        depth = max((-distance_of(body, wall).value for body in base), default=-np.inf)
        if depth > _IN_BASE:
            found[wall.name] = (
                f"{key}[{number}] ({wall.name}): the arm's base is {1e3 * depth:.0f} mm inside it: is its place or "
                "size in another unit? A body is solid: a cage is a wall for each of its sides"
            )
    return found


def _small(cell: Cell) -> dict[str, tuple[float, ...]]:
    """Return the sizes that are smaller than those of any stand or gripper, m, by key."""
    small: dict[str, tuple[float, ...]] = {}
    if max(cell.stand_size) < _THIN_STAND:
        small["boards.stand_size_mm"] = cell.stand_size
    tool = cell.tool
    if isinstance(tool, Gripper) and tool.urdf is None:
        if tool.finger[2] < _THIN or tool.finger[0] < _THIN / 5.0:
            small["tool.finger_mm"] = tool.finger
        if tool.palm[1] < tool.opening / 2.0:
            small["tool.palm_mm"] = tool.palm
        if tool.body_radius < _THIN:
            small["tool.body_radius_mm"] = (tool.body_radius,)
    return small


def _short_fingers(cell: Cell) -> Iterator[str]:
    """Say that the palm is in every cube that is gripped."""
    if not isinstance(cell.tool, Gripper) or cell.tool.urdf is not None:
        return
    room = cell.grip_height + cell.tool.finger[2] - (cell.cube_size - CUBE_SEAT_DEPTH)
    if room < 0.0 and cell.grip_height >= _HIGH:
        yield (
            f"tool.finger_mm = {[round(1e3 * v, 6) for v in cell.tool.finger]}: with tool.grip_height_mm = "
            f"{1e3 * cell.grip_height:g} the palm is {-1e3 * room:.0f} mm inside a gripped cube: is the third of them "
            "the length from palm to tip?"
        )


def _sunk(cell: Cell) -> Iterator[str]:
    """Say which wall over the table has its middle in the table's top, as one whose foot was given."""
    table = cell.fixed[0]
    for number, wall in enumerate(cell.walls):
        if not isinstance(wall.shape, Box) or not isinstance(table.shape, Box):
            continue
        height, z = wall.shape.size[2], float(wall.T_base_body[2, 3])
        apart = np.abs(wall.T_base_body[:2, 3] - table.T_base_body[:2, 3])
        over = bool((apart < np.array(table.shape.size[:2]) / 2.0).all())
        if over and height >= _TALL and abs(z - cell.table_z) < _TALL / 10.0:
            yield (
                f"walls[{number}] ({wall.name}): its lower half is below the table's top: is centre_mm that of its "
                f"foot? Its middle is {500.0 * height:g} mm above it"
            )


def _beyond_table(cell: Cell) -> Iterator[str]:
    """Say that the zone for boards reaches beyond the edge of the table."""
    table, zone = cell.fixed[0], cell.zone
    if not isinstance(table.shape, Box) or not isinstance(zone.shape, Box):
        return
    apart = np.abs(zone.T_base_body[:2, 3] - table.T_base_body[:2, 3])
    half_zone, half_table = (np.array(box.size[:2]) / 2.0 for box in (zone.shape, table.shape))
    if (beyond := float((apart + half_zone - half_table).max())) > _BESIDE:
        yield (
            f"table.centre_mm and table.size_mm: the zone for boards reaches {1e3 * beyond:.0f} mm beyond the table; "
            "are they in cm? The arm is not kept away from what is not in the file"
        )
