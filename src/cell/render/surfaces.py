"""Where a ray meets a body, and how bright the body is there.

A ray starts at the camera's centre and has depth 1 along the camera's z per unit of its parameter, so depths of
different bodies compare directly. Shading is Lambert's: one distant light and an ambient part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.bodies import Body, Box, Cylinder, Sphere
from arm.se3 import Array

ALBEDO = {"table": 120.0, "wall": 90.0, "stand": 80.0, "board": 205.0, "cube": 190.0, "robot": 150.0}
LIGHT = np.array([0.35, -0.25, 0.90]) / np.linalg.norm([0.35, -0.25, 0.90])  # towards the light, base frame
AMBIENT = 0.45


@dataclass(frozen=True, eq=False)
class Hit:
    """What rays meet: depth (infinite where they pass), brightness, and the point in the body's frame."""

    depth: Array
    grey: Array
    points: tuple[Array, Array, Array] | None = None


def lambert(normals_base: Array) -> Array:
    """Brightness factor of surfaces with normals (..., 3) in the base frame."""
    return AMBIENT + (1.0 - AMBIENT) * np.clip(normals_base @ LIGHT, 0.0, None)


class BodyRays:
    """Rays of a camera in a body's frame: origin (3,) and directions as three arrays."""

    def __init__(self, T_base_body: Array, T_base_camera: Array, x: Array, y: Array) -> None:
        R = T_base_body[:3, :3]
        M = R.T @ T_base_camera[:3, :3]
        self.origin = R.T @ (T_base_camera[:3, 3] - T_base_body[:3, 3])
        self.direction = [M[i, 0] * x + M[i, 1] * y + M[i, 2] for i in range(3)]
        self.R = R

    def points(self, depth: Array) -> tuple[Array, Array, Array]:
        """Points at given depths, in the body's frame."""
        a, b, c = (o + depth * d for o, d in zip(self.origin, self.direction, strict=True))
        return a, b, c


def meet(body: Body, rays: BodyRays) -> Hit:
    """Rays against a body."""
    albedo = ALBEDO.get(body.kind, 128.0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        match body.shape:
            case Box(size):
                return _box(np.array(size) / 2.0, rays, albedo)
            case Cylinder(radius, length):
                return _cylinder(radius, length / 2.0, rays, albedo)
            case Sphere(radius):
                return _sphere(radius, rays, albedo)


def _box(half: Array, rays: BodyRays, albedo: float) -> Hit:
    enter, leave = np.full(rays.direction[0].shape, 0.0), np.full(rays.direction[0].shape, np.inf)
    face = np.zeros(enter.shape, dtype=np.int8)
    for axis in range(3):
        o, d = rays.origin[axis], rays.direction[axis]
        sign = np.where(d > 0.0, 1.0, -1.0)
        near, far = (-half[axis] * sign - o) / d, (half[axis] * sign - o) / d
        later = near > enter
        enter = np.where(later, near, enter)
        face = np.where(later, np.where(d > 0.0, 2 * axis, 2 * axis + 1), face)
        leave = np.minimum(leave, far)
    normals = np.array([s * rays.R[:, axis] for axis in range(3) for s in (-1.0, 1.0)])
    grey = (albedo * lambert(normals))[face]
    return Hit(np.where((enter <= leave) & (enter > 0.0), enter, np.inf), grey)


def _cylinder(radius: float, half: float, rays: BodyRays, albedo: float) -> Hit:
    (ox, oy, oz), (dx, dy, dz) = rays.origin, rays.direction
    a, b, c = dx * dx + dy * dy, ox * dx + oy * dy, ox * ox + oy * oy - radius**2
    side = (-b - np.sqrt(b * b - a * c)) / a
    z = oz + side * dz
    side_hits = (side > 0.0) & (np.abs(z) <= half)
    sign = np.where(dz > 0.0, -1.0, 1.0)
    cap = (sign * half - oz) / dz
    cap_hits = (cap > 0.0) & ((ox + cap * dx) ** 2 + (oy + cap * dy) ** 2 <= radius**2)
    normal = np.stack([(ox + side * dx) / radius, (oy + side * dy) / radius, np.zeros_like(side)], axis=-1)
    normal[~side_hits] = 0.0
    shade_side = lambert(normal @ rays.R.T)
    shade_cap = np.where(sign > 0.0, lambert(rays.R[:, 2]), lambert(-rays.R[:, 2]))
    depth = np.where(side_hits, side, np.inf)
    nearer = cap_hits & (cap < depth)
    return Hit(np.where(nearer, cap, depth), albedo * np.where(nearer, shade_cap, shade_side))


def _sphere(radius: float, rays: BodyRays, albedo: float) -> Hit:
    direction = np.stack(rays.direction, axis=-1)
    a = np.sum(direction * direction, axis=-1)
    b = direction @ rays.origin
    c = rays.origin @ rays.origin - radius**2
    depth = (-b - np.sqrt(b * b - a * c)) / a
    hits = depth > 0.0
    normal = (rays.origin + np.where(hits, depth, 0.0)[..., None] * direction) / radius
    return Hit(np.where(hits, depth, np.inf), albedo * lambert(normal @ rays.R.T))
