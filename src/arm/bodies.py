"""Rigid bodies of simple shape: what is collided, drawn and rendered. Plain values, no collision library."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from arm.errors import A465Error, InputError
from arm.se3 import Array, frozen, orthonormalised

LEAST_LENGTH, MOST_LENGTH = 1e-4, 100.0  # of a body that is read from a file, m


@dataclass(frozen=True)
class Box:
    """A box centred on its frame; `size` (3,) full edge lengths, m."""

    size: tuple[float, float, float]


@dataclass(frozen=True)
class Cylinder:
    """A cylinder centred on its frame, axis along z; `radius` and full `length`, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class Sphere:
    """A sphere centred on its frame; `radius`, m."""

    radius: float


Shape = Box | Cylinder | Sphere


@dataclass(frozen=True)
class Body:
    """A named shape at a pose.

    Attributes:
        name: unique in its scene; messages use it.
        shape: Box, Cylinder or Sphere.
        T_base_body: pose in the base frame, 4x4.
        kind: what it is to the planner and the eye: table, wall, post, stand, board, cube, robot.
    """

    name: str
    shape: Shape
    T_base_body: Array
    kind: str

    def at(self, T_base_body: Array) -> Body:
        """The same body at another pose."""
        return replace(self, T_base_body=frozen(T_base_body))


def shape_to_json(shape: Shape) -> dict[str, Any]:
    """A shape as JSON types, lengths in metres."""
    match shape:
        case Box(size):
            return {"box": list(size)}
        case Cylinder(radius, length):
            return {"cylinder": [radius, length]}
        case Sphere(radius):
            return {"sphere": radius}


def shape_from_json(value: dict[str, Any]) -> Shape:
    """The inverse of `shape_to_json`.

    Raises:
        InputError: not a known shape.
    """
    match value:
        case {"box": [x, y, z]}:
            return Box((_length(x), _length(y), _length(z)))
        case {"cylinder": [radius, length]}:
            return Cylinder(_length(radius), _length(length))
        case {"sphere": radius}:
            return Sphere(_length(radius))
    raise InputError(f"shape = {value!r}: must be a box, cylinder or sphere", value=value)


def _length(value: Any) -> float:
    length = float(value)
    if not LEAST_LENGTH <= length <= MOST_LENGTH:
        raise InputError(
            f"length = {length:g} m: must be from {LEAST_LENGTH:g} to {MOST_LENGTH:g}", value=length
        )
    return length


def body_to_json(body: Body) -> dict[str, Any]:
    """A body as JSON types."""
    return {
        "name": body.name,
        "kind": body.kind,
        "shape": shape_to_json(body.shape),
        "T_base_body": body.T_base_body.tolist(),
    }


def body_from_json(value: Any) -> Body:
    """The inverse of `body_to_json`.

    Raises:
        InputError: not a body: a key is missing, a size not positive, a pose not rigid.
    """
    try:
        name, kind, shape = value["name"], value["kind"], shape_from_json(value["shape"])
        pose = orthonormalised(value["T_base_body"], tolerance=1e-6)
    except (KeyError, TypeError, ValueError, A465Error) as error:
        raise InputError(f"body {str(value)[:60]}: {type(error).__name__} {error}", value=value) from error
    if not isinstance(name, str) or not isinstance(kind, str):
        raise InputError(f"body {str(name)[:60]}: name and kind must be texts", value=value)
    return Body(name, shape, pose, kind)
