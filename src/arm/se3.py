"""Rigid transforms as read-only 4x4 arrays. `T_a_b` maps coordinates in frame b to frame a.

Rotation vectors and twists follow J. Solà et al., "A micro Lie theory for state estimation in robotics"
(2018), eqs. 69-76 for SO(3); translations in metres, angles in radians.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from arm.errors import A465Error
from arm.numerics.angles import arctan2
from arm.numerics.products import mul, nearest_rotation, norm

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]


def frozen(array: npt.ArrayLike) -> Array:
    """Return a read-only float copy of `array`, any shape."""
    copy = np.array(array, dtype=float)
    copy.flags.writeable = False
    return copy


def transform(R: npt.ArrayLike | None = None, t: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Return the 4x4 transform with rotation `R` (3x3, identity by default) and translation `t` (3,) m."""
    T = np.eye(4)
    if R is not None:
        T[:3, :3] = R
    T[:3, 3] = t
    return frozen(T)


def inverse(T: Array) -> Array:
    """Return T_b_a for T_a_b (4x4)."""
    R = T[:3, :3]
    return transform(R.T, mul(-R.T, T[:3, 3]))


def apply(T_a_b: Array, points_b: npt.ArrayLike) -> Array:
    """Map points (..., 3) from frame b to frame a."""
    return mul(np.asarray(points_b, dtype=float), T_a_b[:3, :3].T) + T_a_b[:3, 3]


def skew(v: npt.ArrayLike) -> Array:
    """Return the 3x3 matrix with skew(v) @ w == cross(v, w)."""
    x, y, z = np.asarray(v, dtype=float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(a: Array, b: Array) -> Array:
    """Return a x b of vectors (..., 3), broadcast; five times as fast as numpy for few vectors."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    x = ay * bz - az * by
    product: Array = np.empty((*x.shape, 3))
    product[..., 0], product[..., 1], product[..., 2] = x, az * bx - ax * bz, ax * by - ay * bx
    return product


def by_twist(by_point: Array, points: Array) -> Array:
    """Convert derivatives with respect to points of a body to derivatives with respect to its twist.

    A twist (v, w) moves a point p by v + w x p, and a . (w x p) = w . (p x a).

    Args:
        by_point: (..., r, 3), derivatives with respect to the point.
        points: (..., 3), in the body's frame.

    Returns:
        (..., r, 6), with respect to the twist in the body's frame, translation first.
    """
    return np.concatenate([by_point, cross(points[..., None, :], by_point)], axis=-1)


def rotation(rotation_vector: npt.ArrayLike) -> Array:
    """Return the rotation matrix (3x3) of a rotation vector (3,) rad: SO(3) exponential (Rodrigues)."""
    w = np.asarray(rotation_vector, dtype=float)
    angle = float(norm(w))
    W = skew(w)
    if angle < 1e-8:
        return np.asarray(np.eye(3) + W + mul(0.5 * W, W))
    a, b = np.sin(angle) / angle, (1.0 - np.cos(angle)) / angle**2
    R: Array = np.eye(3) + a * W + mul(b * W, W)
    return R


def rotations(rotation_vectors: Array) -> Array:
    """Return the rotation matrices (..., 3, 3) by rotation vectors (..., 3), many at once (Rodrigues' formula)."""
    x, y, z = np.moveaxis(rotation_vectors, -1, 0)
    angle = np.sqrt(x * x + y * y + z * z)
    a, b = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    R = np.empty((*angle.shape, 3, 3))
    R[..., 0, 0], R[..., 1, 1], R[..., 2, 2] = (
        1 - b * (y * y + z * z),
        1 - b * (x * x + z * z),
        1 - b * (x * x + y * y),
    )
    R[..., 0, 1], R[..., 1, 0] = b * x * y - a * z, b * x * y + a * z
    R[..., 0, 2], R[..., 2, 0] = b * x * z + a * y, b * x * z - a * y
    R[..., 1, 2], R[..., 2, 1] = b * y * z - a * x, b * y * z + a * x
    return R


def moved(T: Array, twist: npt.NDArray[Any]) -> Array:
    """Return T exp(twist), to first order in the translation: `T` (4x4) moved by a twist (6,) in its own frame."""
    return mul(T, transform(rotation(twist[3:]), twist[:3]))


def rotation_vector(R: Array) -> Array:
    """Return the rotation vector (3,) rad, of angle in [0, pi], of a rotation matrix (3x3): SO(3) logarithm."""
    vee = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine, cosine = 0.5 * float(norm(vee)), 0.5 * (float(np.trace(R)) - 1.0)
    angle = float(arctan2(sine, cosine))
    if sine < 1e-12 and cosine > 0.0:
        return 0.5 * vee
    if sine > 1e-6 or cosine > 0.0:
        return angle * vee / (2.0 * sine)
    # near an angle of pi, the axis comes from R + R^T and its sign from the skew part
    symmetric = 0.5 * (R + R.T) - cosine * np.eye(3)
    column = int(np.argmax(np.diag(symmetric)))
    axis = symmetric[:, column] / norm(symmetric[:, column])
    return angle * axis * (-1.0 if mul(vee, axis) < 0.0 else 1.0)


def rot_x(angle: float) -> Array:
    """Return the rotation (3x3) about x by `angle` rad."""
    return rotation((angle, 0.0, 0.0))


def rot_y(angle: float) -> Array:
    """Return the rotation (3x3) about y by `angle` rad."""
    return rotation((0.0, angle, 0.0))


def rot_z(angle: float) -> Array:
    """Return the rotation (3x3) about z by `angle` rad."""
    return rotation((0.0, 0.0, angle))


def angle_between(R_a: Array, R_b: Array) -> float:
    """Return the angle between two rotations (3x3), rad."""
    return float(norm(rotation_vector(mul(R_a.T, R_b))))


def orthonormalised(T: npt.ArrayLike, tolerance: float = 1e-3) -> Array:
    """Return the rigid transform nearest to `T` (4x4), for matrices that were printed or typed with few digits.

    Raises:
        A465Error: `T` is further than `tolerance` from any rotation, is mirrored, or its last row is not 0 0 0 1.
    """
    M = np.array(T, dtype=float)
    if M.shape != (4, 4) or not np.isfinite(M).all() or not np.allclose(M[3], (0.0, 0.0, 0.0, 1.0)):
        raise A465Error("must be a finite 4x4 matrix with last row 0 0 0 1", matrix=M.tolist())
    singular_values = np.linalg.svd(M[:3, :3], compute_uv=False)
    near = np.abs(singular_values - 1.0).max() <= tolerance
    if near and np.linalg.det(M[:3, :3]) < 0.0:
        why = "the upper left 3x3 part is mirrored, with determinant -1: one axis is reversed; a tool that points down "
        raise A465Error(f"{why}has two, such as z and y: rows 1 0 0, 0 -1 0, 0 0 -1", matrix=M.tolist())
    if not near:
        raise A465Error(
            "the upper left 3x3 part is not a rotation: singular values "
            f"{np.round(singular_values, 6).tolist()} must be 1 to within {tolerance:g}, determinant positive",
            matrix=M.tolist(),
        )
    return transform(nearest_rotation(M[:3, :3]), M[:3, 3])
