"""Cast rays at solids: depth, grey level and smooth piece of the surface ("region") of each first hit.

Solids are invisible from inside, where no camera is.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from arm.robot.shapes import Body, Box, Capsule, Convex, Cylinder, Sphere, Torus
from arm.se3 import Array, inverse
from render.hulls import Hull
from render.light import Light, body_grey
from render.rays import Bundle, Floats, PixelRays, bundle_in

REGIONS = 32  # a solid has fewer; faces of a hull share one if their numbers differ by a multiple of it
SEAM = 1e-7  # m; overlap of faces, so that rounding leaves no gap between them
_MARCHES, _MET = 300, 1e-6  # most steps along a ray, and the distance from a torus that counts as met, m


class Cast(NamedTuple):
    """Hits of rays of any shape: depth (infinite for misses), grey level, region below `REGIONS`."""

    depth: Floats
    grey: Floats
    region: npt.NDArray[np.uint8]


class Solid(Protocol):
    """Something that rays can hit."""

    @property
    def T_base_solid(self) -> Array:
        """Pose in the base frame, 4x4."""

    @property
    def half_extent(self) -> Array:
        """Half edges (3,) m of its bounding box, in its frame and centred there."""

    def cast(self, T_base_camera: Array, rays: PixelRays) -> Cast:
        """Cast the rays of a camera at it."""


class BodySolid:
    """A body of simple shape and one grey level, lit; `grey` (facing the lamp) defaults to that of its kind."""

    def __init__(self, body: Body, light: Light, grey: float | None = None) -> None:
        self.T_base_solid = body.T_base_body
        self.half_extent = _half_extent(body)
        self._shape = body.shape
        self._grey = body_grey(body) if grey is None else grey
        self._light = light
        self._lamp = body.T_base_body[:3, :3].T @ light.towards(body.T_base_body[:3, 3])
        self._hull = Hull(body.shape) if isinstance(body.shape, Convex) else None

    def cast(self, T_base_camera: Array, rays: PixelRays) -> Cast:
        """Cast the rays of a camera at the body."""
        bundle = bundle_in(inverse(self.T_base_solid) @ T_base_camera, rays)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # misses, and rays along a face
            match self._shape:
                case Box():
                    levels = self._grey * self._light.lambert(np.concatenate([self._lamp, -self._lamp]))
                    return cast_box(self.half_extent, bundle, levels)
                case Cylinder(radius, length):
                    return self._cylinder(radius, length / 2.0, bundle)
                case Sphere(radius):
                    return self._sphere(radius, bundle)
                case Capsule(radius, length):
                    return self._capsule(radius, length / 2.0, bundle)
                case Torus(radius, tube):
                    return self._torus(radius, tube, bundle)
                case Convex():
                    return self._convex(bundle)

    def _shaded(self, cosine: Floats) -> Floats:
        return (self._grey * self._light.lambert(cosine)).astype(np.float32)

    def _cylinder(self, radius: float, half: float, rays: Bundle) -> Cast:
        (ox, oy, oz), dx, dy, dz = _single(rays.origin), rays.dx, rays.dy, rays.dz
        a = dx * dx + dy * dy
        cross = ox * dy - oy * dx
        t = (-(ox * dx + oy * dy) - np.sqrt(np.float32(radius**2) * a - cross * cross)) / a
        on_side = (t > 0.0) & (np.abs(oz + t * dz) <= half + SEAM)
        depth = np.where(on_side, t, np.float32(np.inf))
        lx, ly, lz = _single(self._lamp)
        cosine = ((ox + t * dx) * lx + (oy + t * dy) * ly) / np.float32(radius)
        grey = self._shaded(np.where(on_side, cosine, np.float32(0.0)))
        region = np.zeros(t.shape, dtype=np.uint8)
        if abs(oz) > half:
            sign = np.sign(oz)
            t = (sign * np.float32(half) - oz) / dz
            on_cap = (t > 0.0) & ((ox + t * dx) ** 2 + (oy + t * dy) ** 2 <= (radius + SEAM) ** 2)
            depth[on_cap], region[on_cap] = t[on_cap], 1
            grey[on_cap] = self._shaded(sign * lz)
        return Cast(depth, grey, region)

    def _sphere(self, radius: float, rays: Bundle) -> Cast:
        (ox, oy, oz), dx, dy, dz = _single(rays.origin), rays.dx, rays.dy, rays.dz
        a = dx * dx + dy * dy + dz * dz
        b = ox * dx + oy * dy + oz * dz
        # |o x d|^2 instead of |o|^2 |d|^2 - (o . d)^2, which suffers from cancellation
        cross2 = (oy * dz - oz * dy) ** 2 + (oz * dx - ox * dz) ** 2 + (ox * dy - oy * dx) ** 2
        t = (-b - np.sqrt(np.float32(radius**2) * a - cross2)) / a
        met = t > 0.0
        depth = np.where(met, t, np.float32(np.inf))
        lx, ly, lz = _single(self._lamp)
        cosine = ((ox + t * dx) * lx + (oy + t * dy) * ly + (oz + t * dz) * lz) / np.float32(radius)
        return Cast(depth, self._shaded(np.where(met, cosine, 0.0)), np.zeros(t.shape, dtype=np.uint8))

    def _capsule(self, radius: float, half: float, rays: Bundle) -> Cast:
        """The nearest of the cylinder's side and the two balls; one smooth piece."""
        side = self._cylinder(radius, half, rays)
        depth = np.where(side.region == 0, side.depth, np.float32(np.inf))  # the cylinder's ends are inside
        grey = side.grey
        for sign in (-1.0, 1.0):
            moved = Bundle(rays.origin - (0.0, 0.0, sign * half), rays.dx, rays.dy, rays.dz)
            ball = self._sphere(radius, moved)
            outer = sign * (moved.origin[2] + ball.depth * rays.dz) >= -SEAM
            nearer = (ball.depth < depth) & outer
            depth, grey = np.where(nearer, ball.depth, depth), np.where(nearer, ball.grey, grey)
        return Cast(depth, grey, np.zeros(depth.shape, dtype=np.uint8))

    def _torus(self, radius: float, tube: float, rays: Bundle) -> Cast:
        """March along each ray by the distance from the torus, until it is met or passed."""
        way = np.stack([rays.dx, rays.dy, rays.dz], axis=-1).astype(float).reshape(-1, 3)
        length = np.sqrt((way * way).sum(axis=1))
        depth, marched = np.full(len(way), np.inf), np.zeros(len(way))
        # past the point nearest to the centre, and the body
        last = (radius + tube - (way @ rays.origin) / length) / length
        on_way = np.arange(len(way))
        inside = np.hypot(np.hypot(*rays.origin[:2]) - radius, rays.origin[2]) <= tube
        for _ in range(0 if inside else _MARCHES):
            at = rays.origin + marched[on_way, None] * way[on_way]
            gap = np.hypot(np.hypot(at[:, 0], at[:, 1]) - radius, at[:, 2]) - tube
            met = gap < _MET
            depth[on_way[met]] = marched[on_way[met]]
            marched[on_way] += gap / length[on_way]
            on_way = on_way[~met & (marched[on_way] < last[on_way])]
        at = rays.origin + np.where(np.isfinite(depth), depth, 0.0)[:, None] * way
        across = np.hypot(at[:, 0], at[:, 1])
        at[:, :2] -= radius * at[:, :2] / across[:, None]  # from the circle
        grey = self._shaded(np.where(np.isfinite(depth), at @ self._lamp / tube, 0.0).astype(np.float32))
        shape = rays.dx.shape
        return Cast(
            depth.astype(np.float32).reshape(shape), grey.reshape(shape), np.zeros(shape, dtype=np.uint8)
        )

    def _convex(self, rays: Bundle) -> Cast:
        if self._hull is None:
            raise TypeError("only a convex shape has a hull")
        depth, face = self._hull.enter(rays, SEAM)
        levels = self._shaded(_single(self._hull.normals @ self._lamp))
        return Cast(depth, levels[face], (face % REGIONS).astype(np.uint8))


def cast_box(half: Array, rays: Bundle, levels: Array) -> Cast:
    """Cast rays at the box with half edges `half` (3,) m; grey `levels` (6,) of its faces +x +y +z -x -y -z.

    The region of a hit is the number of its face.
    """
    directions = (rays.dx, rays.dy, rays.dz)
    depth = np.full(rays.dx.shape, np.inf, dtype=np.float32)
    grey = np.zeros(rays.dx.shape, dtype=np.float32)
    region = np.zeros(rays.dx.shape, dtype=np.uint8)
    o = _single(rays.origin)
    for axis in range(3):
        if abs(rays.origin[axis]) <= half[axis]:
            continue  # neither of the two faces is towards the camera
        sign = np.sign(o[axis])
        t = (sign * np.float32(half[axis]) - o[axis]) / directions[axis]
        met = t > 0.0
        for other in range(3):
            if other != axis:
                met &= np.abs(o[other] + t * directions[other]) <= half[other] + SEAM
        face = axis if sign > 0.0 else axis + 3
        np.copyto(depth, t, where=met)
        grey[met], region[met] = levels[face], face
    return Cast(depth, grey, region)


def _single(values: Array) -> Floats:
    return values.astype(np.float32)


def _half_extent(body: Body) -> Array:
    match body.shape:
        case Box(size):
            return np.array(size) / 2.0
        case Cylinder(radius, length):
            return np.array([radius, radius, length / 2.0])
        case Sphere(radius):
            return np.full(3, radius)
        case Capsule(radius, length):
            return np.array([radius, radius, length / 2.0 + radius])
        case Torus(radius, tube):
            return np.array([radius + tube, radius + tube, tube])
        case Convex(points):
            return np.asarray(np.abs(points).max(axis=0))
