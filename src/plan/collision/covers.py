"""Simple bodies that contain a shape: balls, the hull of balls, and a rounded box."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from arm.numerics.products import norm
from arm.robot.shapes import Box, Capsule, Convex, Cylinder, Shape, Sphere, Torus
from arm.se3 import Array
from plan.collision.enclosing import few_points

ROUNDING = 1e-7  # m, safety for rounding errors on radii and distance bounds
_MOST_BALLS = 4  # balls that cover a long body
_SIDES = 16  # of the polygons in and around the circle of a torus; with a ball for each, a ring of 65 mm has a hole


@lru_cache(maxsize=1024)
def hull(shape: Shape) -> tuple[Array, float]:
    """Return points (n, 3) and a radius; the hull of balls of that radius about the points contains the body."""
    match shape:
        case Box(size):
            signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
            return signs * (np.array(size) / 2.0), 0.0
        case Cylinder(radius, length) | Capsule(radius, length):
            return np.array([[0.0, 0.0, -length / 2.0], [0.0, 0.0, length / 2.0]]), radius
        case Sphere(radius):
            return np.zeros((1, 3)), radius
        case Torus(radius, tube):
            return _polygon(radius / np.cos(np.pi / _SIDES)), tube
        case Convex(points):
            return few_points(np.array(points))


@lru_cache(maxsize=1024)
def cover(shape: Shape) -> tuple[Array, float]:
    """Return centres (n, 3) and the radius of equal balls that cover the body."""
    match shape:
        case Sphere(radius):
            return np.zeros((1, 3)), radius
        case Capsule(radius, length):
            return _row(np.array([0.0, 0.0, length + 2.0 * radius]), radius)
        case Cylinder(radius, length):
            return _row(np.array([0.0, 0.0, length]), radius)
        case Box(size):
            across = np.delete(np.array(size), int(np.argmax(size)))
            return _row(np.array(size), float(norm(across)) / 2.0)
        case Torus(radius, tube):
            # about the middles of chords; the furthest points of the torus are its outermost ones above their ends
            half_chord = np.sin(np.pi / _SIDES)
            ball = np.sqrt(radius * (radius + 2.0 * tube) * half_chord**2 + tube**2)
            return _polygon(radius * np.cos(np.pi / _SIDES)), float(ball)
        case Convex(points):
            corners = np.array(points)
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
            size = np.ptp(corners, axis=0)
            across = np.delete(corners - middle, int(np.argmax(size)), axis=1)
            centres, ball = _row(size, float(np.sqrt((across * across).sum(axis=1).max())))
            return middle + centres, ball


def _row(size: Array, across: float) -> tuple[Array, float]:
    """Place balls along the longest edge of a box, which hold all within `across` of its axis."""
    axis = int(np.argmax(size))
    count = int(np.clip(np.ceil(size[axis] / max(2.0 * across, 1e-9)), 1, _MOST_BALLS))
    part = size[axis] / count
    centres = np.zeros((count, 3))
    centres[:, axis] = (np.arange(count) - (count - 1) / 2.0) * part
    return centres, float(np.hypot(across, part / 2.0))


def _polygon(radius: float) -> Array:
    """Return the corners (`_SIDES`, 3) of a polygon in a circle about z."""
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.zeros(_SIDES)])


@lru_cache(maxsize=1024)
def rounded_box(shape: Shape) -> tuple[Array, Array, float, float]:
    """Return a box (middle, half sizes), the radius of a disc across z and of a ball; their sum contains the body."""
    middle = np.zeros(3)
    match shape:
        case Box(size):
            return middle, np.array(size) / 2.0, 0.0, 0.0
        case Cylinder(radius, length):
            return middle, np.array([0.0, 0.0, length / 2.0]), radius, 0.0
        case Capsule(radius, length):
            return middle, np.array([0.0, 0.0, length / 2.0]), 0.0, radius
        case Sphere(radius):
            return middle, np.zeros(3), 0.0, radius
        case Torus(radius, tube):
            return middle, np.zeros(3), radius, tube
        case Convex(points):
            corners = np.array(points)
            low, high = corners.min(axis=0), corners.max(axis=0)
            return (low + high) / 2.0, (high - low) / 2.0, 0.0, 0.0
