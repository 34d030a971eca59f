"""Bodies from tables of a cell file or scene file: boxes unless `shape` says otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from arm.errors import InputError
from arm.io.keys import Keys, key, read_values
from arm.io.node import Node
from arm.io.rules import carried, line, number, numbers, path, standing, text, triple, turns
from arm.numerics.products import mul
from arm.robot.mesh import read_mesh_points
from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Shape, Sphere, Torus, convex
from arm.se3 import Array, rot_x, rot_y, rot_z, transform

MESH_UNITS = {"mm": 1e-3, "m": 1.0}
FARTHEST_MM, LARGEST_MM = 5000, 10000
_SMALLEST = 1e-3  # m, of a mesh
_LENGTH = number("mm", 1, LARGEST_MM)
PLACE = numbers(3, "mm", -FARTHEST_MM, FARTHEST_MM)
ON_FLANGE = carried(FARTHEST_MM)  # of a tool
PLACES = {"wall": standing(3, -FARTHEST_MM, FARTHEST_MM), "tool": ON_FLANGE}  # by the kind of a body
TURN = turns(3)
_PLACED = ("centre", "origin")  # fields of which a shape has one
SHAPE = text("box", "cylinder", "sphere", "capsule", "torus", "mesh")


class BodyKeys(Keys):
    """Keys of a body of any shape."""

    name: str = key("name", line())
    shape: str = key("shape", SHAPE, "box")
    size: tuple[float, float, float] = key("size_mm", triple("mm", 1, LARGEST_MM))
    radius: float = key("radius_mm", _LENGTH)
    length: float = key("length_mm", _LENGTH)
    tube: float = key("tube_mm", _LENGTH)
    mesh: Path = key("mesh", path())
    mesh_unit: str = key("mesh_unit", text(*MESH_UNITS))
    centre: Array = key("centre_mm", PLACE)
    origin: Array = key("origin_mm", PLACE)
    rpy: Array = key("rpy_deg", TURN, [0, 0, 0])


def read_body(node: Node, kind: str) -> Body:
    """Read a body from a table with the keys of its shape.

    Raises:
        InputError: a value is wrong, or a key is unknown for the shape; names file, key, value and rule.
    """
    shape = node.get("shape", SHAPE, "mesh" if "mesh" in node else "box")
    make, parts = SHAPES[shape]
    place = _place(parts)
    wanted = {"name", "shape", "rpy", place, *parts}
    _refuse_of_other_shapes(node, shape, wanted)
    values = read_values({name: one for name, one in BodyKeys.declared().items() if name in wanted}, node)
    if kind in PLACES:  # one in metres would be in the arm, or in the flange
        node.get(BodyKeys.declared()[place].name, PLACES[kind])
    if not values["name"]:
        raise node.error_at("name", "must not be empty")
    made = make(node, *(values[part] for part in parts))
    return Body(values["name"], made, pose_of(values[place], values["rpy"]), kind)


def _place(parts: Sequence[str]) -> str:
    """Return which field places a shape of these fields."""
    return "origin" if "mesh" in parts else "centre"


def _refuse_of_other_shapes(node: Node, shape: str, wanted: Iterable[str]) -> None:
    """Refuse a key that another shape has, or a diameter, before what is missing is told instead of it."""
    of = f"a {shape}" if "shape" in node else f"a {shape}, which a body without shape is"
    for field, one in BodyKeys.declared().items():
        if field not in wanted and one.name in node:
            owners = [name for name, (_, parts) in SHAPES.items() if field in (*parts, _place(parts))]
            place = BodyKeys.declared()[_place(SHAPES[shape][1])].name
            help = (
                f"of a {shape} it is {place}" if field in _PLACED else f"shape {' or '.join(owners)} has it"
            )
            raise node.error_at(one.name, f"is not a known key of {of}", help)
    if "diameter_mm" in node:
        raise node.error_at("diameter_mm", "is not a known key", "give radius_mm, which is half of it")


def require_names_differ(tables: Node, bodies: Sequence[Body], others: Sequence[Body] = ()) -> None:
    """Require different names of bodies.

    Args:
        tables: of the bodies.
        bodies: read from them.
        others: bodies whose names they must not have either.

    Raises:
        InputError: two have the same.
    """
    for index, body in enumerate(bodies):
        if any(body.name == other.name for other in (*others, *bodies[:index])):
            raise tables.items()[index].error_at("name", "is used twice; names of bodies must differ")


def pose_of(place: Array, rpy: Array) -> Array:
    """Return T_base_body of a position, m, and rotations about the fixed x, y, z axes in this order, rad."""
    roll, pitch, yaw = rpy
    return transform(mul(mul(rot_z(yaw), rot_y(pitch)), rot_x(roll)), place)


def _hull(node: Node, file: Path, unit: str) -> Convex:
    """Return the convex hull, which contains the mesh. The unit is required: mesh files do not state it."""
    try:
        points = MESH_UNITS[unit] * read_mesh_points(file)
        size = np.ptp(points, axis=0)
        fits = _SMALLEST <= size.max() <= LARGEST_MM / 1e3
        hull = convex(points) if fits else None
    except InputError as error:
        raise node.error_at("mesh", f"cannot be used: {error}") from error
    if hull is not None:
        return hull
    if size.max() < _SMALLEST:
        shown = " x ".join(f"{1e3 * v:.3g}" for v in size)
        rule = f"makes the mesh {shown} mm; a body must be {1e3 * _SMALLEST:g} mm or more along one axis"
        raise node.error_at("mesh_unit", rule, "is it in m?")
    shown = " x ".join(f"{v:.4g}" for v in size)
    rule = f"makes the mesh {shown} m; a body may be at most {LARGEST_MM / 1e3:g} m"
    raise node.error_at("mesh_unit", rule, "is it in mm?")


def _ring(node: Node, radius: float, tube: float) -> Torus:
    if tube >= radius:
        rule = f"must be less than radius_mm, {1e3 * radius:g}: a torus has a hole"
        raise node.error_at("tube_mm", rule, "both are radii: of the tube, and of its centre line")
    return Torus(radius, tube)


SHAPES: dict[str, tuple[Callable[..., Shape], tuple[str, ...]]] = {
    "box": (lambda _, size: Box(size), ("size",)),
    "cylinder": (lambda _, radius, length: Cylinder(radius, length), ("radius", "length")),
    "sphere": (lambda _, radius: Sphere(radius), ("radius",)),
    "capsule": (lambda _, radius, length: Capsule(radius, length), ("radius", "length")),
    "torus": (_ring, ("radius", "tube")),
    "mesh": (_hull, ("mesh", "mesh_unit")),
}
"""Constructor and own keys of each shape."""
