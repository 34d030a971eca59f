"""Lens distortion of D. C. Brown, "Close-range camera calibration" (1971), after a pinhole projection.

Coefficients in OpenCV's order k1 k2 p1 p2 k3, on the plane z = 1 of the camera frame:
x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and y' likewise with p1 and p2 swapped.
"""

from __future__ import annotations

import numpy as np

from arm.se3 import Array

_INVERSE_STEPS, _STEP_TOLERANCE, _WORST_STEP = 50, 1e-13, 1e-9


def distortion_terms(coefficients: Array, points: Array) -> tuple[Array, Array]:
    """Radial factor (...) and tangential shift (..., 2) at undistorted `points` (..., 2)."""
    k1, k2, p1, p2, k3 = coefficients.tolist()
    x, y = points[..., 0], points[..., 1]
    with np.errstate(over="ignore", invalid="ignore"):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        tangential = np.empty_like(points)
        tangential[..., 0] = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        tangential[..., 1] = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return radial, tangential


def distort(coefficients: Array, points: Array) -> Array:
    """Map undistorted points (..., 2) on z = 1 to distorted ones."""
    if not any(coefficients.tolist()):  # a pinhole, where a calibration starts
        return np.array(points)
    radial, tangential = distortion_terms(coefficients, points)
    return np.asarray(points * radial[..., None] + tangential)


def undistort(coefficients: Array, distorted: Array) -> Array:
    """Invert `distort` to 1e-13, by fixed-point iteration; NaN where it finds no inverse."""
    if not any(coefficients.tolist()):
        return np.array(distorted)
    points = distorted
    change = np.zeros_like(points)
    for _ in range(_INVERSE_STEPS):
        radial, tangential = distortion_terms(coefficients, points)
        with np.errstate(all="ignore"):
            better = (distorted - tangential) / radial[..., None]
            change = np.abs(better - points)
        points = better
        if not (change > _STEP_TOLERANCE).any():
            return points
    return np.where((change <= _WORST_STEP).all(axis=-1, keepdims=True), points, np.nan)


def distortion_jacobian(coefficients: Array, points: Array) -> Array:
    """Derivative of `distort`: points (..., 2) to (..., 2, 2)."""
    k1, k2, p1, p2, k3 = coefficients.tolist()
    x, y = points[..., 0], points[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))  # the radial factor's derivative by x is slope * x
    J: Array = np.empty((*points.shape[:-1], 2, 2))
    J[..., 0, 0] = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
    J[..., 1, 1] = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
    J[..., 0, 1] = J[..., 1, 0] = slope * x * y + 2.0 * (p1 * x + p2 * y)
    return J
