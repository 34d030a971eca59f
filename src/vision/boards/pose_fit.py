"""Fit one pose to all corners of a board's markers in all frames: robust Levenberg-Marquardt on SE(3).

The fit is in the camera frame. Steps are twists in the board's own frame (translation first), T <- T exp(xi) to first
order (J. Solà et al. 2018, section 4.3, right Jacobian).

Part of a corner's error is new in each frame; another part is common to all frames (light, blur, distortion). A corner
that is wrong in one frame differs from the other frames. One that is wrong in all of them differs only from the board's
shape. So outliers are rejected twice: among frames, then among corners.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from arm.se3 import Array, Bools, moved, rotation, transform
from vision.camera.model import Camera
from vision.camera.projection import Projection

# standard deviations: a frame's corner loses weight above the first, all above the second
TRUSTED, REFUSED = 3.5, 6.0
SMALLEST_SIGMA_PX = 0.02  # smallest corner noise assumed in outlier tests
WRONG_CORNER_F = 30.0  # limit of F(2, 8): rejects a correct corner in 0.15 % of all fits
STEP_DONE = 1e-9  # m and rad, last step of a fit: a millionth of the precision from corners of 0.01 px
NEAR = 1e-6  # m and rad, last step while weights still change
_ROBUST_ROUNDS, _STEPS = 12, 30


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of one board in all frames.

    Attributes:
        pixels: (frames, n, 2) px, NaN where a corner was not detected.
        points: (n, 3) m in the board frame, z = 0.
    """

    pixels: Array
    points: Array

    def median(self) -> Array:
        """Median of each corner over the frames in which it was detected, (n, 2) px."""
        return np.asarray(np.nanmedian(self.pixels, axis=0))


@dataclass(frozen=True, eq=False)
class Fit:
    """A pose fitted to corners.

    Attributes:
        T_camera_board: 4x4.
        mean_px: weighted mean of each corner over the frames, (n, 2) px.
        weights: of every corner in every frame, (frames, n), 0 for outliers and missing corners.
        shares: information on each mean corner, (n,), 1 for one detected in an average number of frames.
        mean_residual_px: `mean_px` minus the projection, (n, 2) px.
    """

    T_camera_board: Array
    mean_px: Array
    weights: Array
    shares: Array
    mean_residual_px: Array

    @property
    def cost(self) -> float:
        """Minimised sum of squared residuals of the mean corners, weighted by shares, px^2; inf without a pose."""
        return float(self.shares @ (self.mean_residual_px**2).sum(axis=-1)) if self.valid else np.inf

    @property
    def valid(self) -> bool:
        """Whether all corners are in front of the camera and some are used; else there is no pose."""
        return bool(np.isfinite(self.mean_residual_px).all() and self.shares.any())

    @property
    def freedom(self) -> int:
        """Degrees of freedom of `cost`."""
        return 2 * int(np.count_nonzero(self.shares)) - 6

    @property
    def frames(self) -> float:
        """Mean number of frames per used corner."""
        totals = self.weights.sum(axis=0)
        return float(totals.sum() / max(np.count_nonzero(totals), 1))


def planar_poses(pixels: Array, points: Array, camera: Camera) -> tuple[Array, ...]:
    """Return both poses T_camera_board of a planar set of points, better first (T. Collins and A. Bartoli, IPPE, 2014).

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
    """Fit the pose near `start` (T_camera_board, 4x4) robustly.

    For given weights the sum over frames has the same minimum as the weighted mean corners, so each robust round fits
    only n mean corners, whatever the number of frames.
    """
    used: Bools = np.asarray(np.isfinite(corners.pixels).all(axis=-1))
    fit = _without_bad_frames(corners, used, start, camera)
    wrong = _wrong_corner(fit, corners.points, camera)
    if wrong is not None:
        used = used & (np.arange(len(corners.points)) != wrong)
        fit = _without_bad_frames(corners, used, fit.T_camera_board, camera)
    return fit


def _without_bad_frames(corners: Corners, used: Bools, start: Array, camera: Camera) -> Fit:
    """Fit the corners `used` (frames, n), with less weight or none for those that differ from the other frames."""
    fit = fit_weighted(corners, used.astype(float), start, camera, done=NEAR)
    if len(used) == 1 or not fit.valid:  # or behind the camera
        return fit_again(fit, corners.points, fit.T_camera_board, camera)
    pixels = np.nan_to_num(corners.pixels)
    # judge outliers by the median over frames first: with three frames or more it is already free of them
    expected = np.where(used.sum(axis=0)[:, None] > 0, np.nan_to_num(corners.median()), 0.0)
    for _ in range(_ROBUST_ROUNDS):
        distance = np.linalg.norm(pixels - expected, axis=-1)
        weights = np.where(used, _trust(distance / _spread(distance[used])), 0.0)
        shared = _shared_part(corners, fit)
        previous, fit = fit.weights, fit_weighted(corners, weights, fit.T_camera_board, camera, shared, NEAR)
        # if frames agree on a deviation from the board's shape, the corner is expected there
        expected = fit.mean_px - (1.0 - shared * np.minimum(fit.shares, 1.0))[:, None] * fit.mean_residual_px
        if np.abs(weights - previous).max() < 1e-3 or not np.isfinite(expected).all():
            break
    return fit_again(fit, corners.points, fit.T_camera_board, camera)


def fit_weighted(
    corners: Corners,
    weights: Array,
    start: Array,
    camera: Camera,
    shared: float = 0.0,
    done: float = STEP_DONE,
) -> Fit:
    """Fit the least-squares pose near `start` for given weights (frames, n).

    Args:
        shared: share of a mean corner's variance that is common to all frames, 0 to 1.
        done: step at which to stop, m and rad.
    """
    pixels = np.nan_to_num(corners.pixels)
    totals = weights.sum(axis=0)
    used = totals > 0.0
    average = totals.sum() / max(np.count_nonzero(used), 1)
    shares = np.where(used, 1.0 / (shared + (1.0 - shared) * average / np.where(used, totals, 1.0)), 0.0)
    mean = np.einsum("fn,fni->ni", weights, pixels) / np.maximum(totals, 1e-9)[:, None]
    T = _least_squares(mean, shares, corners.points, start, camera, done)
    projected = Projection(camera, T, corners.points).pixels
    mean = np.where(used[:, None], mean, projected)
    return Fit(T, mean, weights, shares, mean - projected)


def fit_again(fit: Fit, points: Array, start: Array, camera: Camera) -> Fit:
    """Refit the mean corners and shares of `fit` from another `start`."""
    T = _least_squares(fit.mean_px, fit.shares, points, start, camera)
    projected = Projection(camera, T, points).pixels
    return replace(fit, T_camera_board=T, mean_residual_px=fit.mean_px - projected)


def frame_variance(corners: Corners, fit: Fit) -> float | None:
    """Variance of a corner's coordinate between frames, px^2; None if no corner is in two of them."""
    totals = fit.weights.sum(axis=0)
    free = totals.sum() - np.count_nonzero(totals)
    if free < 0.5:
        return None
    scatter = (np.nan_to_num(corners.pixels - fit.mean_px) ** 2).sum(axis=-1)
    return float((fit.weights * scatter).sum() / (2.0 * free))


def _shared_part(corners: Corners, fit: Fit) -> float:
    of_frames = frame_variance(corners, fit)
    if of_frames is None or fit.freedom < 1 or fit.cost <= 0.0:
        return 0.0
    return float(np.clip(1.0 - of_frames / fit.frames * fit.freedom / fit.cost, 0.0, 1.0))


def _trust(sigmas: Array) -> Array:
    """1 up to TRUSTED, then smoothly down to 0 at REFUSED: clean corners keep their full weight."""
    along = np.clip((sigmas - TRUSTED) / (REFUSED - TRUSTED), 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * along))


def _spread(distances: Array) -> float:
    """Standard deviation per coordinate from the median residual length (Rayleigh: median = 1.1774 sigma)."""
    return max(float(np.median(distances)) / 1.1774, SMALLEST_SIGMA_PX)


def _wrong_corner(fit: Fit, points: Array, camera: Camera) -> int | None:
    """Index of the corner without which all others fit much better, if there is one (leave-one-out F test)."""
    if fit.freedom < 4 or not fit.valid:
        return None
    root = np.sqrt(fit.shares)[:, None]
    A = root[..., None] * Projection(camera, fit.T_camera_board, points).by_target
    r = root * fit.mean_residual_px
    flat = A.reshape(-1, 6)
    left = np.eye(2) - A @ np.linalg.inv(flat.T @ flat) @ A.transpose(0, 2, 1)
    gain = np.where(fit.shares > 0.0, (r * np.linalg.solve(left, r[..., None])[..., 0]).sum(axis=-1), 0.0)
    worst = int(np.argmax(gain))
    rest = max((fit.cost - gain[worst]) / (fit.freedom - 2), SMALLEST_SIGMA_PX**2)
    return worst if gain[worst] / 2.0 > WRONG_CORNER_F * rest else None


def _least_squares(
    mean: Array, shares: Array, points: Array, T: Array, camera: Camera, done: float = STEP_DONE
) -> Array:
    """Fit the pose near `T` to the mean corners (n, 2) px, weighted by their shares (n,)."""
    root = np.sqrt(shares)[:, None]
    damping = 1e-6

    def residuals(seen: Projection) -> Array:
        return np.asarray((root * (mean - seen.pixels)).reshape(-1))

    seen = Projection(camera, T, points)
    now = residuals(seen)
    for _ in range(_STEPS):
        J = (root[..., None] * seen.by_target).reshape(-1, 6)
        H, g = J.T @ J, J.T @ now
        xi = np.linalg.solve(H + damping * np.diag(np.diag(H)), g)
        candidate = Projection(camera, moved(seen.T, xi), points)
        then = residuals(candidate)
        if then @ then <= now @ now:
            seen, now, damping = candidate, then, damping * 0.1
        else:
            damping *= 10.0
        if np.abs(xi).max() < done or damping > 1e6:
            break
    return seen.T
