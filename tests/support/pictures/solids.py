"""Random solids and their distances."""

from __future__ import annotations

import numpy as np

from arm.robot.shapes import Box, Capsule, Convex, Cylinder, Shape, Sphere, Torus, convex, hull_faces
from arm.se3 import Array, rotation, transform


def signed_distance(shape: Shape, points: Array) -> Array:
    """Of points (..., 3) m of the body's frame to its surface, negative inside; of hulls at most that far."""
    match shape:
        case Capsule(radius, length):
            axis = np.clip(points[..., 2], -length / 2.0, length / 2.0)[..., None] * (0.0, 0.0, 1.0)
            return np.asarray(np.linalg.norm(points - axis, axis=-1) - radius)
        case Torus(radius, tube):
            across = np.hypot(points[..., 0], points[..., 1]) - radius
            return np.asarray(np.hypot(across, points[..., 2]) - tube)
        case Convex():
            faces = hull_faces(shape)
            return np.asarray((points @ faces.normals.T - faces.offsets).max(axis=-1))
        case Box(size):
            q = np.abs(points) - np.array(size) / 2.0
        case Cylinder(radius, length):
            radial = np.hypot(points[..., 0], points[..., 1]) - radius
            q = np.stack([radial, np.abs(points[..., 2]) - length / 2.0], axis=-1)
        case Sphere(radius):
            return np.asarray(np.linalg.norm(points, axis=-1) - radius)
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=-1)
    return np.asarray(outside + np.minimum(q.max(axis=-1), 0.0))


def random_shape(rng: np.random.Generator) -> Shape:
    a, b, c = rng.uniform(0.02, 0.3, 3)
    hull = convex(rng.uniform(-0.5, 0.5, (12, 3)) * (a, b, c))
    shapes: tuple[Shape, ...] = (
        Box((a, b, c)),
        Cylinder(a / 2, b),
        Sphere(a / 2),
        Capsule(a / 2, b),
        hull,
        Torus(a / 2, b / 8),
    )
    return shapes[int(rng.integers(len(shapes)))]


SOLID_CUBE = convex([(x, y, z) for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])


def random_pose(rng: np.random.Generator, spread: float) -> Array:
    return transform(rotation(rng.normal(size=3)), (0.49, 0.0, 0.2) + rng.uniform(-spread, spread, 3))
