"""Bodies from tables of a cell file or scene file: boxes unless `shape` says otherwise."""

from __future__ import annotations

import numpy as np

from arm.errors import InputError
from arm.io.toml_reader import TomlTable
from arm.numerics.products import mul
from arm.robot.mesh import read_mesh_points
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Shape, Sphere, convex
from arm.se3 import Array, rot_x, rot_y, rot_z, transform

SHAPES = ("box", "cylinder", "sphere", "capsule", "mesh")
MESH_UNITS = {"mm": 1e-3, "m": 1.0}
FARTHEST_MM, LARGEST_MM = 5000, 10000


def read_body(table: TomlTable, kind: str) -> Body:
    """Read a body from a table. Unknown keys are refused.

    Keys: `name`; `shape`, one of `SHAPES` (default: mesh if there is a key `mesh`, else box); the shape's lengths
    (`size_mm` | `radius_mm`, `length_mm` | `mesh`, `mesh_unit`); `centre_mm`, or for a mesh `origin_mm`, the position
    of its file's origin; `rpy_deg` (see `read_pose`).

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    name = table.text("name")
    shape = read_shape(table)
    pose = read_pose(table, "origin_mm" if isinstance(shape, Convex) else "centre_mm")
    table.finish()
    return Body(name, shape, pose, kind)


def read_shape(table: TomlTable) -> Shape:
    """Read the shape of a table; see `read_body`.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    match table.text("shape", choices=SHAPES, default="mesh" if "mesh" in table else "box"):
        case "cylinder":
            return Cylinder(_length(table, "radius_mm"), _length(table, "length_mm"))
        case "capsule":
            return Capsule(_length(table, "radius_mm"), _length(table, "length_mm"))
        case "sphere":
            return Sphere(_length(table, "radius_mm"))
        case "mesh":
            return _hull_of_mesh(table)
        case _:
            x, y, z = (float(v) for v in table.numbers("size_mm", 3, "mm", 1, LARGEST_MM) / 1e3)
            return Box((x, y, z))


def read_pose(table: TomlTable, place_key: str) -> Array:
    """Read T_base_body from a position in mm and `rpy_deg`: rotations about the fixed x, y, z axes in this order."""
    place = table.numbers(place_key, 3, "mm", -FARTHEST_MM, FARTHEST_MM) / 1e3
    roll, pitch, yaw = np.radians(table.numbers("rpy_deg", 3, "deg", -360, 360, default=(0.0, 0.0, 0.0)))
    return transform(mul(mul(rot_z(yaw), rot_y(pitch)), rot_x(roll)), place)


def _length(table: TomlTable, key: str) -> float:
    return table.number(key, "mm", 1, LARGEST_MM) / 1e3


def _hull_of_mesh(table: TomlTable) -> Convex:
    """Return the convex hull, which contains the mesh. The unit is required: mesh files do not state it."""
    path = table.path("mesh")
    scale = MESH_UNITS[table.text("mesh_unit", choices=tuple(MESH_UNITS))]
    try:
        hull = convex(scale * read_mesh_points(path))
    except InputError as error:
        raise table.error("mesh", f"cannot be used: {error}") from error
    size = np.ptp(hull.points, axis=0)
    if not size.max() <= LARGEST_MM / 1e3:
        raise table.error(
            "mesh_unit",
            f"makes the mesh {' x '.join(f'{v:.4g}' for v in size)} m; a body may be at most {LARGEST_MM / 1e3:g} m",
            "is it in mm?",
        )
    return hull
