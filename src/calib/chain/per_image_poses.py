"""Fit a pose of the target to each image alone, to estimate the noise of the corners and to find wrong corners.

No arm is involved, so this is the reference for an arm's model: if residuals are larger with the arm, the arm is why.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from arm.errors import InputError
from arm.se3 import Array, Bools
from calib.camera.bundle_adjustment import View
from calib.camera.initial_guess import pose_of
from calib.model.chi_square import chi2_limit, chi2_quantile
from vision.camera.model import Camera
from vision.camera.projection import Projection

FEWEST = 4  # corners of an image
WRONG_CORNER = 6.0  # standard deviations
_MANY = 8  # corners needed to identify wrong ones
# images and standard deviations needed to conclude that the images' noise differs
_FEW_IMAGES, _SURE = 6, 3.0
_PER_AXIS = 16  # corners needed to estimate x and y separately
_FINEST = 1e-6  # px; rendered images have no noise, and weights need some
_QUARTILES = 1.3489795003921634  # between the quartiles of a normal distribution of unit variance


@dataclass(frozen=True, eq=False)
class PerImagePoses:
    """Poses of a target fitted to each image alone.

    Attributes:
        T_camera_target: (n, 4, 4).
        residuals: (n, m, 2) px, NaN where a corner was not detected.
        pixel_sigma: standard deviation of a corner's x and y, (2,) px.
        freedom: degrees of freedom of `pixel_sigma`.
        noise: of each image's corners, relative to a typical image, (n,), because far, oblique or blurred targets are
            detected less accurately; 1 if images do not differ significantly.
        wrong: (n, m) corners that do not fit the others of their image.
    """

    T_camera_target: Array
    residuals: Array
    pixel_sigma: Array
    freedom: float
    noise: Array
    wrong: Bools


def fit_per_image_poses(camera: Camera, points: Array, pixels: Array) -> PerImagePoses:
    """Fit a pose to every image.

    The standard deviation comes from the better half of the images, so a few with wrong corners have no influence.

    Args:
        camera: at the origin.
        points: (m, 3) m in the target frame.
        pixels: (n, m, 2), NaN where a corner was not detected; at least four in every image.

    Raises:
        InputError: an image has fewer than four corners within the camera's view, or no pose fits it.
    """
    used = pixels.copy()
    with np.errstate(all="ignore"):
        wrong = np.isfinite(pixels[..., 0]) & ~np.isfinite(camera.normalised(pixels)).all(axis=-1)
    used[wrong] = np.nan
    few = np.flatnonzero(np.isfinite(used[..., 0]).sum(axis=1) < FEWEST)
    if len(few):
        raise InputError(
            f"image {few[0]}: fewer than {FEWEST} of its corners lie within the camera's view; are they in px, and of "
            "this camera, with its distortion in the order k1 k2 p1 p2 k3?",
            images=few.tolist(),
        )
    for _ in range(4):
        mask = np.isfinite(used[..., 0])
        poses = np.array(
            [pose_of(View(points[here], image[here]), camera) for image, here in zip(used, mask, strict=True)]
        )
        residuals, left_share = _residuals(camera, points, pixels, mask, poses)
        sigma, freedom = _sigma(residuals, left_share, mask)
        off = np.linalg.norm(residuals / sigma, axis=-1)
        lost = np.flatnonzero(~np.isfinite(off).any(axis=1))
        if len(lost):
            why = f"image {lost[0]}: no pose of the target fits; is it this target, and this camera?"
            raise InputError(why, images=lost.tolist())
        worst = np.nanargmax(off, axis=1)
        rows = np.arange(len(off))
        count = mask.sum(axis=1)
        far = (off > WRONG_CORNER) & (off >= 0.5 * off[rows, worst][:, None])
        # if most corners are far off, the image shows something else, and no corner can be singled out
        drop = (count > _MANY) & ~wrong[rows, worst] & (2 * far.sum(axis=1) < count) & far[rows, worst]
        if not drop.any():
            break
        far &= drop[:, None]
        wrong |= far
        used[far] = np.nan
    noise = _noise(residuals / sigma, np.where(np.isfinite(used), left_share, 0.0))
    return PerImagePoses(poses, residuals, sigma, freedom, noise, wrong)


def _residuals(
    camera: Camera, points: Array, pixels: Array, used: Bools, poses: Array
) -> tuple[Array, Array]:
    """Residuals of all corners (n, m, 2), and the fraction of each coordinate's variance left in them."""
    projection = Projection(camera, poses, points)
    Q, _ = np.linalg.qr(np.where(used[..., None, None], projection.by_target, 0.0).reshape(len(poses), -1, 6))
    return pixels - projection.pixels, 1.0 - (Q**2).sum(axis=-1).reshape(pixels.shape)


def _sigma(residuals: Array, left_share: Array, used: Bools) -> tuple[Array, float]:
    """Standard deviation of x and y, (2,) px, from the images with smaller residuals, and its degrees of freedom."""
    squares = np.where(used[..., None], residuals, 0.0) ** 2
    left = np.where(used[..., None], left_share, 0.0)
    freedom = left.sum(axis=(1, 2))
    usable = freedom > 0.5
    mean = squares.sum(axis=(1, 2))[usable] / freedom[usable]
    typical = np.median(mean) / np.median(chi2_quantile(0.5, freedom[usable]) / freedom[usable])
    good = usable.copy()
    good[usable] = mean * freedom[usable] < typical * chi2_limit(1e-4, freedom[usable])
    total = squares[good].sum(axis=(0, 1)), left[good].sum(axis=(0, 1))
    if np.median(used.sum(axis=1)) < _PER_AXIS:
        return np.full(2, max(np.sqrt(total[0].sum() / total[1].sum()), _FINEST)), float(total[1].sum())
    return np.maximum(np.sqrt(total[0] / total[1]), _FINEST), float(total[1].sum())


def _noise(whitened: Array, left_share: Array) -> Array:
    """Noise of each image, (n,), shrunk towards 1 by empirical Bayes.

    The variances have an inverse chi-square prior. Its degrees of freedom come from the spread of their logarithms, as
    far as it exceeds the spread that few corners cause.
    """
    freedom = left_share.sum(axis=(1, 2))
    squares = np.where(left_share > 0.0, whitened, 0.0) ** 2
    total = np.nansum(squares, axis=(1, 2))
    usable = freedom > 1.0
    if usable.sum() < _FEW_IMAGES:
        return np.ones(len(freedom))
    logs = np.log(np.maximum(total[usable], 1e-12) / freedom[usable])
    low, high = np.percentile(logs, [25.0, 75.0])
    spread = float((high - low) / _QUARTILES) ** 2
    chance = float(np.mean(special.polygamma(1, freedom[usable] / 2.0)))
    surplus = spread - chance
    if surplus <= _SURE * chance * np.sqrt(2.0 / usable.sum()):
        return np.ones(len(freedom))
    prior = 2.0 / surplus
    return np.asarray(np.sqrt((prior + total) / (prior + freedom)))
