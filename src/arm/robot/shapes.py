"""Rigid bodies of simple shape for collision checks, previews and rendering. Plain values, no collision library."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.arguments import number, numbers, rigid, shown
from arm.errors import A465Error, InputError
from arm.numerics.products import mul
from arm.se3 import Array, frozen, orthonormalised, rot_x, rot_z, transform

LEAST_LENGTH, MOST_LENGTH = 1e-4, 100.0  # m, sizes of a body that is read from a file
_CAPSULES = 32  # that stand for a torus
_LEAST, _MOST = 1e-6, 1e4  # m, sizes of any body; beyond these, distances lose precision


class _Round:
    """Base of shapes with a radius and perhaps a length: checks them on construction."""

    def __post_init__(self) -> None:
        for key, value in list(vars(self).items()):
            object.__setattr__(self, key, _size(f"{type(self).__name__}.{key}", value))


def _size(name: str, value: Any) -> float:
    return number(name, value, _LEAST, _MOST, "m", "sizes are positive, full lengths and radii in metres")


@dataclass(frozen=True)
class Box:
    """A box centred on its frame; `size` (3,) full edge lengths, m.

    All shapes raise InputError if a size is not a finite positive number.
    """

    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        size = self.size
        if isinstance(size, str) or not hasattr(size, "__len__") or len(size) != 3:
            why = f"Box.size = {shown(size)}: must be three full edge lengths x, y, z in m"
            raise InputError(why, name="size")
        checked = tuple(_size(f"Box.size[{i}]", value) for i, value in enumerate(size))
        object.__setattr__(self, "size", checked)


@dataclass(frozen=True)
class Cylinder(_Round):
    """A cylinder centred on its frame, axis along z; `radius` and full `length`, m."""

    radius: float
    length: float


@dataclass(frozen=True)
class Sphere(_Round):
    """A sphere centred on its frame; `radius`, m."""

    radius: float


@dataclass(frozen=True)
class Capsule(_Round):
    """A cylinder with a half ball on each end, centred on its frame, axis along z.

    `radius`, and `length` between the centres of the balls, m.
    """

    radius: float
    length: float


@dataclass(frozen=True)
class Torus(_Round):
    """A circle of `radius` about the z axis, centred on its frame, swept by a ball of radius `tube`, m."""

    radius: float
    tube: float


@dataclass(frozen=True)
class Convex:
    """The convex hull of `points`, (n, 3) m in its frame; at least four, not all in one plane."""

    points: tuple[tuple[float, float, float], ...]

    def __post_init__(self) -> None:
        p = numbers(self.points)
        if p is None or p.ndim != 2 or p.shape[1] != 3 or len(p) < 4 or not np.isfinite(p).all():
            raise InputError(
                f"Convex.points = {shown(self.points if p is None else p)}: must be four or more points of three "
                "finite numbers x, y, z in m",
                name="points",
            )
        thick, wide = thickness(p), float(np.ptp(p, axis=0).max())
        if not (thick >= _LEAST and wide <= _MOST):
            why = (
                f"Convex.points: {wide:.4g} m wide and {thick:.3g} m thick; must not lie in one plane, and measure "
                f"{_LEAST:g} to {_MOST:g} m"
            )
            raise InputError(why, name="points", thickness_m=thick)
        if type(self.points) is not tuple or not all(type(point) is tuple for point in self.points):
            object.__setattr__(self, "points", tuple((float(x), float(y), float(z)) for x, y, z in p))


@dataclass(frozen=True, eq=False)
class Faces:
    """Triangles of a hull.

    Attributes:
        corners: (m, 3) indices of its points, counter-clockwise seen from outside.
        normals: (m, 3) unit vectors, outwards.
        offsets: (m,) m; a point p in the triangle's plane has normal @ p == offset.
    """

    corners: npt.NDArray[np.intp]
    normals: Array
    offsets: Array


Simple = Box | Cylinder | Sphere | Capsule | Convex
Shape = Simple | Torus
_SHAPES = (Box, Cylinder, Sphere, Capsule, Torus, Convex)


@dataclass(frozen=True)
class Body:
    """A named shape at a pose.

    Attributes:
        name: unique in its scene.
        shape: see `Shape`.
        T_base_body: pose in the base frame, 4x4.
        kind: for planner and display: table, wall, post, stand, board, cube, robot.
        padding: uncertainty of the surface, m; subtracted from every distance.

    Raises:
        InputError: not a name, not a shape, a pose that is not rigid to 1e-6, or a padding that is not from 0 to 100 m.
    """

    name: str
    shape: Shape
    T_base_body: Array
    kind: str
    padding: float = 0.0

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name and isinstance(self.kind, str)):
            why = f"body: name = {shown(self.name)}, kind = {shown(self.kind)}: must be strings, the name not empty"
            raise InputError(why, name=shown(self.name))
        if not isinstance(self.shape, _SHAPES):
            kinds = "a Box, Cylinder, Sphere, Capsule, Torus or Convex"
            why = f"body {self.name!r}: shape = {shown(self.shape)}: must be {kinds}"
            raise InputError(why, name=self.name)
        object.__setattr__(self, "T_base_body", rigid(f"body {self.name!r}: T_base_body", self.T_base_body))
        if self.padding != 0.0:  # 0, the usual value, needs no check
            checked = number(f"body {self.name!r}: padding", self.padding, 0.0, MOST_LENGTH, "m")
            object.__setattr__(self, "padding", checked)

    def at(self, T_base_body: Array) -> Body:
        """Return the same body at another pose."""
        return replace(self, T_base_body=frozen(T_base_body))


def shape_to_json(shape: Shape) -> dict[str, Any]:
    """Return a shape as JSON types, lengths in m."""
    match shape:
        case Box(size):
            return {"box": list(size)}
        case Cylinder(radius, length):
            return {"cylinder": [radius, length]}
        case Sphere(radius):
            return {"sphere": radius}
        case Capsule(radius, length):
            return {"capsule": [radius, length]}
        case Torus(radius, tube):
            return {"torus": [radius, tube]}
        case Convex(points):
            return {"convex": [list(p) for p in points]}


def shape_from_json(value: dict[str, Any]) -> Shape:
    """Invert `shape_to_json`.

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
        case {"capsule": [radius, length]}:
            return Capsule(_length(radius), _length(length))
        case {"torus": [radius, tube]}:
            return Torus(_length(radius), _length(tube))
        case {"convex": [*points]}:
            return convex(points)
    why = f"shape = {str(value)[:80]}: must be a box, cylinder, sphere, capsule, torus or convex"
    raise InputError(why, value=value)


def convex(points: npt.ArrayLike) -> Convex:
    """Return the hull of points (n, 3) m, without inner points and independent of their order.

    Raises:
        InputError: fewer than four points, all in one plane, or larger or thinner than a body may be.
    """
    p = np.asarray(points, dtype=float)
    if p.ndim != 2 or p.shape[1:] != (3,) or len(p) < 4 or not np.isfinite(p).all():
        why = f"convex: points of shape {p.shape}; must be four or more points of x, y, z"
        raise InputError(why, shape=p.shape)
    p = np.unique(p, axis=0)
    size = np.ptp(p, axis=0)
    if not (thickness(p) >= LEAST_LENGTH and size.max() <= MOST_LENGTH):
        raise InputError(
            f"convex: points span {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} m; must not lie in one plane, and "
            f"measure {LEAST_LENGTH:g} to {MOST_LENGTH:g} m",
            size=size.tolist(),
        )
    from scipy.spatial import ConvexHull  # slow to import and rarely needed

    corners = p[np.sort(ConvexHull(p).vertices)]
    while len(corners) < len(p):  # until nothing is dropped, so that the hull of a hull is the same
        p, corners = corners, corners[np.sort(ConvexHull(corners).vertices)]
    return Convex(tuple((float(x), float(y), float(z)) for x, y, z in corners))


def thickness(points: Array) -> float:
    """Return the extent of points (n, 3) across their best-fitting plane, m."""
    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    return float(np.ptp(mul(centred, axes[-1]))) if len(axes) == 3 else 0.0


def simple_parts(shape: Shape, covering: bool = False) -> list[tuple[Simple, Array]]:
    """Return the shape, or capsules along the circle of a torus, with poses in its frame (4x4).

    For programs that know no torus. The capsules form a polygon, whose corners are outside of the circle by 0.25 % of
    its radius, and the middles of its edges inside by the same. They have the radius of the tube or, if `covering`, as
    much more, so that they contain the torus.
    """
    if not isinstance(shape, Torus):
        return [(shape, transform())]
    half_angle = np.pi / _CAPSULES
    corner = 2.0 * shape.radius / (1.0 + np.cos(half_angle))
    size = shape.tube + (corner - shape.radius if covering else 0.0)
    part = Capsule(size, 2.0 * corner * np.sin(half_angle))
    edge = transform(rot_x(np.pi / 2.0), (corner * np.cos(half_angle), 0.0, 0.0))
    return [(part, mul(transform(rot_z(2.0 * half_angle * i)), edge)) for i in range(_CAPSULES)]


def hull_faces(shape: Convex) -> Faces:
    """Return the surface of a hull as triangles; a flat face may have several."""
    from scipy.spatial import ConvexHull

    p = np.array(shape.points)
    hull = ConvexHull(p)
    corners, planes = hull.simplices.copy(), hull.equations
    normals = np.cross(p[corners[:, 1]] - p[corners[:, 0]], p[corners[:, 2]] - p[corners[:, 0]])
    inwards = (normals * planes[:, :3]).sum(axis=1) < 0.0
    corners[inwards] = corners[inwards][:, ::-1]
    return Faces(corners.astype(np.intp), frozen(planes[:, :3]), frozen(-planes[:, 3]))


def _length(value: Any) -> float:
    length = float(value)
    if not LEAST_LENGTH <= length <= MOST_LENGTH:
        why = f"length = {length:g} m: must be from {LEAST_LENGTH:g} to {MOST_LENGTH:g}"
        raise InputError(why, value=length)
    return length


def body_to_json(body: Body) -> dict[str, Any]:
    """Return a body as JSON types; a padding of 0 is left out."""
    value = {
        "name": body.name,
        "kind": body.kind,
        "shape": shape_to_json(body.shape),
        "T_base_body": body.T_base_body.tolist(),
    }
    return {**value, "padding": body.padding} if body.padding else value


def body_from_json(value: Any) -> Body:
    """Invert `body_to_json`.

    Raises:
        InputError: a key is missing, a size is not positive, or a pose is not rigid.
    """
    try:
        name, kind, shape = value["name"], value["kind"], shape_from_json(value["shape"])
        pose = orthonormalised(value["T_base_body"], tolerance=1e-6)
        padding = value.get("padding", 0.0)
    except (KeyError, TypeError, ValueError, A465Error) as error:
        raise InputError(f"body {str(value)[:60]}: {type(error).__name__} {error}", value=value) from error
    if not isinstance(name, str) or not isinstance(kind, str):
        raise InputError(f"body {str(name)[:60]}: name and kind must be strings", value=value)
    return Body(name, shape, pose, kind, padding)
