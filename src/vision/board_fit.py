"""One pose from all corners of a board's markers in all frames: robust Levenberg-Marquardt on SE(3).

The fit lives in the camera frame; steps are twists in the board's own frame (translation first), T <- T exp(xi) to
first order (J. Solà et al. 2018, section 4.3, right Jacobian).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from arm.se3 import Array, rotation, transform
from vision.camera import Camera

TUKEY_WIDTH = 6.0  # in standard deviations; costs 1 % of efficiency on clean corners
SMALLEST_SIGMA_PX = 0.02  # corners closer than this are not outliers of each other
STEP_DONE = 1e-9  # m and rad: a millionth of what corners of 0.01 px determine
_ROBUST_ROUNDS, _STEPS = 12, 30


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of one board in all frames.

    Attributes:
        pixels: (frames, n, 2) px, NaN where a corner was not seen.
        points: (n, 3) m in the board frame, z = 0.
    """

    pixels: Array
    points: Array

    def median(self) -> Array:
        """Median of each corner over the frames that saw it, (n, 2) px."""
        return np.asarray(np.nanmedian(self.pixels, axis=0))


@dataclass(frozen=True, eq=False)
class Fit:
    """A pose that fits corners.

    Attributes:
        T_camera_board: 4x4.
        mean_px: weighted mean of each corner over the frames, (n, 2) px.
        weights: of every corner of every frame, (frames, n), 0 for outliers and unseen.
        mean_residual_px: `mean_px` minus the projection, (n, 2) px.
    """

    T_camera_board: Array
    mean_px: Array
    weights: Array
    mean_residual_px: Array

    @property
    def cost(self) -> float:
        """What the fit minimised, per frame: weighted squares of the mean corners' residuals, px^2."""
        totals = self.weights.sum(axis=0)
        return float(totals @ (self.mean_residual_px**2).sum(axis=-1) / max(totals.mean(), 1e-9))


def planar_poses(pixels: Array, points: Array, camera: Camera) -> tuple[Array, ...]:
    """Both poses T_camera_board of a planar set of points, better first (T. Collins and A. Bartoli, IPPE, 2014).

    Args:
        pixels: (n, 2) px.
        points: (n, 3) m, z = 0, not on one line.
    """
    _, rotations, translations, _ = cv2.solvePnPGeneric(
        objectPoints=points,
        imagePoints=camera.normalised(pixels),
        cameraMatrix=np.eye(3),
        distCoeffs=None,
        flags=cv2.SOLVEPNP_IPPE,
    )
    return tuple(
        transform(rotation(r.reshape(3)), t.reshape(3)) for r, t in zip(rotations, translations, strict=True)
    )


def fit_pose(corners: Corners, start: Array, camera: Camera) -> Fit:
    """The pose near `start` (T_camera_board, 4x4) that fits the corners, outliers weighed down by Tukey's biweight.

    For given weights the sum over frames has the same minimum as their weighted mean, so each robust round fits n
    mean corners, however many frames there are.
    """
    T = start
    seen: npt.NDArray[np.bool_] = np.asarray(np.isfinite(corners.pixels).all(axis=-1))
    pixels = np.where(seen[..., None], corners.pixels, 0.0)
    weights = seen.astype(float)
    # the median over frames is the first judge of outliers: with three frames or more it is free of them already
    expected = corners.median()
    for _ in range(_ROBUST_ROUNDS):
        distance = np.linalg.norm(pixels - expected, axis=-1)
        width = TUKEY_WIDTH * _spread(distance[seen])
        previous, weights = (
            weights,
            np.where(seen, np.clip(1.0 - (distance / width) ** 2, 0.0, None) ** 2, 0.0),
        )
        fit = fit_weighted(corners, weights, T, camera)
        T, expected = fit.T_camera_board, fit.mean_px - fit.mean_residual_px
        if np.abs(weights - previous).max() < 1e-3:
            break
    return fit


def fit_weighted(corners: Corners, weights: Array, start: Array, camera: Camera) -> Fit:
    """The least-squares pose near `start` for given weights (frames, n)."""
    pixels = np.nan_to_num(corners.pixels)
    totals = weights.sum(axis=0)
    mean = np.einsum("fn,fni->ni", weights, pixels) / np.maximum(totals, 1e-9)[:, None]
    T = _least_squares(mean, totals, corners.points, start, camera)
    projected = camera.project(corners.points @ T[:3, :3].T + T[:3, 3])
    mean = np.where(totals[:, None] > 0.0, mean, projected)
    return Fit(T, mean, weights, mean - projected)


def _spread(distances: Array) -> float:
    """Standard deviation per coordinate from the median length of plane residuals (Rayleigh: median = 1.1774 sigma)."""
    return max(float(np.median(distances)) / 1.1774, SMALLEST_SIGMA_PX)


def pose_jacobian(T_camera_board: Array, points: Array, camera: Camera) -> Array:
    """Derivative of the projections (n, 2) by the twist of the board in its own frame, (n, 2, 6) px per m and rad."""
    R = T_camera_board[:3, :3]
    by_point = camera.projection_jacobian(points @ R.T + T_camera_board[:3, 3]) @ R
    by_turn = np.empty_like(by_point)  # a . (w x p) = w . (p x a), written out: np.cross costs half the fit
    x, y, z = points[:, 0, None], points[:, 1, None], points[:, 2, None]
    by_turn[..., 0] = y * by_point[..., 2] - z * by_point[..., 1]
    by_turn[..., 1] = z * by_point[..., 0] - x * by_point[..., 2]
    by_turn[..., 2] = x * by_point[..., 1] - y * by_point[..., 0]
    return np.concatenate([by_point, by_turn], axis=-1)


def _least_squares(mean: Array, totals: Array, points: Array, T: Array, camera: Camera) -> Array:
    root = np.sqrt(totals)[:, None]
    damping = 1e-6

    def residuals(pose: Array) -> Array:
        return np.asarray((root * (mean - camera.project(points @ pose[:3, :3].T + pose[:3, 3]))).reshape(-1))

    now = residuals(T)
    for _ in range(_STEPS):
        J = (root[..., None] * pose_jacobian(T, points, camera)).reshape(-1, 6)
        H, g = J.T @ J, J.T @ now
        xi = np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
        candidate = T @ transform(rotation(xi[3:]), xi[:3])
        then = residuals(candidate)
        if then @ then <= now @ now:
            T, now, damping = candidate, then, damping * 0.1
        else:
            damping *= 10.0
        if np.abs(xi).max() < STEP_DONE or damping > 1e6:
            break
    return T
