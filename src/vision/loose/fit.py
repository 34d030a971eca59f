"""Fit the pose and width of a cube to the measured sides of its top and to the contacts of a rest, by least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.se3 import Array, apply, by_twist, frozen, inverse, moved, rotation, transform
from vision.loose.rests import Rest, log_scale, prior
from vision.loose.sides import OUTWARD, Sides, side_normals, top_points
from vision.occupancy.edge_response import PlateView
from vision.occupancy.seated import CubeWidth

STEPS = np.array([1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-6])  # m and rad, of the numerical derivatives
UNIT = np.eye(6)
ITERATIONS = 10
LEAST_GAIN = 1e-3  # of the misfit
SWAY_PX = 0.25  # standard deviation of the image's shift against the known camera, along x and y
SWAY_TURN = np.radians(0.02)  # the same of its rotation, about each axis
MOST_TURN = np.radians(20.0)  # per iteration


@dataclass(frozen=True, eq=False)
class PoseFit:
    """A pose that fits sides and a rest.

    Attributes:
        rest: the assumed rest.
        T_base_cube: pose of the cube's centre, 4x4.
        width: fitted edge of the cube, m.
        covariance: of the pose's twist, (6, 6), see `arm.poses`.
        misfit: sum of the squared deviations of sides, contacts and width, in standard deviations.
        worth: -2 log of the evidence for the rest, up to a constant; smaller is better.
    """

    rest: Rest
    T_base_cube: Array
    width: float
    covariance: Array
    misfit: float
    worth: float


def fit_pose(
    view: PlateView,
    sides: Sides,
    rest: Rest,
    T_base_cube: Array,
    T_base_place: Array,
    width: CubeWidth,
    pocket: tuple[float, float] | None,
) -> PoseFit | None:
    """Fit a pose to sides and a rest, from the initial pose `T_base_cube`; None if they do not determine it."""
    T_place_base = inverse(T_base_place)

    def contacts(T: Array, size: float) -> Array:
        return np.append(prior(rest, T_place_base @ T, size, pocket), (size - width.value) / width.std)

    def linearised(T: Array, size: float) -> tuple[Array, Array]:
        own, J_own = _across(view, sides, T, size)
        known = contacts(T, size)
        J_known = np.empty((len(known), 7))
        for i, step in enumerate(STEPS):
            other = moved(T, step * UNIT[i]) if i < 6 else T
            J_known[:, i] = (contacts(other, size + (step if i == 6 else 0.0)) - known) / step
        return np.concatenate([own, known]), np.concatenate([J_own, J_known])

    T, size = np.asarray(T_base_cube), width.value
    r, J = linearised(T, size)
    damping = 1e-3
    for _ in range(ITERATIONS):
        H = J.T @ J
        if not np.isfinite(H).all() or not np.isfinite(r).all():
            return None
        change = -np.linalg.solve(H + damping * np.diag(np.diag(H)), J.T @ r)
        change *= min(1.0, MOST_TURN / max(float(np.linalg.norm(change[3:6])), 1e-12))
        T_next, size_next = moved(T, change[:6]), size + float(change[6])
        r_next, J_next = linearised(T_next, size_next)
        if not np.isfinite(r_next).all() or r_next @ r_next > r @ r:
            damping *= 30.0
            continue
        gain = r @ r - r_next @ r_next
        T, size, r, J, damping = T_next, size_next, r_next, J_next, damping / 10.0
        if gain < LEAST_GAIN:
            break
    H = J.T @ J
    covariance = np.linalg.inv(H)[:6, :6] + _shaken(view, T)
    misfit = float(r @ r)
    worth = misfit + 2.0 * log_scale(rest, size, pocket) + float(np.linalg.slogdet(H)[1])
    return PoseFit(rest, frozen(T), float(size), frozen(0.5 * (covariance + covariance.T)), misfit, worth)


def _across(view: PlateView, sides: Sides, T_base_cube: Array, size: float) -> tuple[Array, Array]:
    """Deviations of measured sides from those of a pose, in standard deviations, (n,), and derivatives, (n, 7)."""
    at, normal = side_normals(view, T_base_cube, size, sides.side, sides.along)
    points = top_points(size, sides.side, sides.along)
    T_camera_cube = view.camera.T_camera_base @ T_base_cube
    by_point = view.camera.projection_jacobian(apply(T_camera_cube, points)) @ T_camera_cube[:3, :3]
    by_point = -(normal[:, None] @ by_point) / sides.std[:, None, None]
    wider = np.concatenate([OUTWARD[sides.side] / 2.0, np.full((len(points), 1), 0.5)], axis=1)
    by_width = np.sum(by_point[:, 0] * wider, axis=1)
    across = np.sum((sides.points - at) * normal, axis=1) / sides.std
    return across, np.column_stack([by_twist(by_point, points)[:, 0], by_width])


def _shaken(view: PlateView, T_base_cube: Array) -> Array:
    """Covariance of a pose's twist, (6, 6), by the camera's motion between images."""
    towards = T_base_cube[:3, :3].T @ (view.camera.T_base_camera[:3, 3] - T_base_cube[:3, 3])
    towards /= np.linalg.norm(towards)
    added = np.zeros((6, 6))
    added[:3, :3] = (SWAY_PX / view.px_per_m()) ** 2 * (np.eye(3) - np.outer(towards, towards))
    added[3:, 3:] = SWAY_TURN**2 * np.eye(3)
    return added


def with_yaw_near(T_base_cube: Array, T_base_place: Array) -> Array:
    """The same cube with its x axis, of the four that are equivalent, nearest to that of the place."""
    R = inverse(T_base_place)[:3, :3] @ T_base_cube[:3, :3]
    quarter = np.round(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]) / (np.pi / 2.0)) * (np.pi / 2.0)
    c, s = round(float(np.cos(quarter))), round(float(np.sin(quarter)))
    return np.asarray(T_base_cube @ transform([[c, s, 0], [-s, c, 0], [0, 0, 1]]))


def turned_to(T_base_cube: Array, normal: Array, size: float) -> Array:
    """The cube, rotated about the middle of its top so that its z axis is `normal` (3,) of the base frame."""
    R = T_base_cube[:3, :3]
    axis = np.cross(R[:, 2], normal)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        return T_base_cube
    R_new = rotation(axis / sine * np.arcsin(min(sine, 1.0))) @ R
    return transform(R_new, T_base_cube[:3, 3] + 0.5 * size * (R[:, 2] - R_new[:, 2]))


def pose_of(x: float, y: float, yaw: float, height: float, T_base_place: Array) -> Array:
    """Pose of a cube that stands upright with its centre `height` m above a place's plane."""
    c, s = np.cos(yaw), np.sin(yaw)
    return with_yaw_near(
        T_base_place @ transform([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], (x, y, height)), T_base_place
    )
