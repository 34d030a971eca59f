"""Unknowns of a hand-eye calibration that act on the image and not on the arm: lens, size of the print, corners' bias.

None of them is exact. The lens has the covariance of its calibration, a print the tolerance of its maker, and detected
corners lie a little inwards or outwards of the true ones. Each changes the image of a target by an amount that is known
per unit from the target's pose in the camera, whatever the arm does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm.se3 import Array, frozen
from calib.camera.score_tests import inwards
from calib.chain.per_image_poses import PerImagePoses, fit_per_image_poses
from calib.model.intrinsics import COUNT, camera_of, vector_of
from calib.recordings.arm import ArmRecording
from vision.camera.model import Camera
from vision.camera.projection import Projection

SIZE, BIAS = "size of the target", "bias of its corners"
_SHOWN = 4.0  # standard deviations from which the bias of the corners is taken off
_RANK = 1e-10  # of the largest variance, all scaled alike: directions below it are held


@dataclass(frozen=True, eq=False)
class ImageEffects:
    """Unknowns of the image, each in units of its own prior standard deviation.

    Attributes:
        names: of the unknowns.
        columns: change of the projected points per unit, (n, m, 2, k) px.
        lens: change of the nine intrinsics per unit of the first unknowns, (9, lens unknowns).
    """

    names: tuple[str, ...]
    columns: Array
    lens: Array

    @classmethod
    def of(cls, recording: ArmRecording, T_camera_target: Array) -> ImageEffects:
        """Return the unknowns for a recording whose targets appear at these poses, (n, 4, 4)."""
        seen = Projection(recording.camera, T_camera_target, recording.points)
        lens = lens_factor(recording.camera)
        size = recording.size_within * (seen.by_point @ recording.points[..., None])
        bias = recording.corners_within * inwards(seen.pixels)[..., None]
        columns = [seen.by_intrinsics @ lens, size, bias]
        names = (*(f"lens {k + 1}" for k in range(lens.shape[1])), SIZE, BIAS)
        return cls(names, frozen(np.concatenate(columns, axis=-1)), frozen(lens))


def poses_without_bias(recording: ArmRecording) -> PerImagePoses:
    """Fit a pose to each image, with the bias of the corners taken off if all images together show it.

    Each image alone would take the bias for noise, and noise that is too large hides the arm's scatter.
    """
    alone = fit_per_image_poses(recording.camera, recording.points, recording.pixels)
    seen = Projection(recording.camera, alone.T_camera_target, recording.points)
    used = (np.isfinite(recording.pixels[..., 0]) & ~alone.wrong)[..., None]
    sigma = alone.noise[:, None, None] * alone.pixel_sigma
    n = len(recording.pixels)
    by_pose = np.where(used[..., None], seen.by_target / sigma[..., None], 0.0).reshape(n, -1, 6)
    by_bias, off = (
        np.where(used, of / sigma, 0.0).reshape(n, -1) for of in (inwards(recording.pixels), alone.residuals)
    )
    Q, _ = np.linalg.qr(by_pose)
    left = by_bias - np.einsum("nri,nsi,ns->nr", Q, Q, by_bias, optimize=True)
    information = float((left**2).sum())
    bias = float((left * off).sum()) / max(information, 1e-300)
    if abs(bias) * np.sqrt(information) < _SHOWN:
        return alone
    shifted = recording.pixels - bias * inwards(recording.pixels)
    return fit_per_image_poses(recording.camera, recording.points, shifted)


def lens_factor(camera: Camera) -> Array:
    """A factor L of the lens's covariance L L^T, (9, k); k = 0 if it is not known."""
    if camera.lens_covariance is None:
        return np.zeros((COUNT, 0))
    scale = np.sqrt(np.diag(camera.lens_covariance))
    free = scale > 0.0
    scale = np.where(free, scale, 1.0)
    variances, directions = np.linalg.eigh(camera.lens_covariance / np.outer(scale, scale))
    kept = variances > _RANK * max(float(variances.max()), 1e-300)
    return np.asarray((scale[:, None] * directions * np.sqrt(np.maximum(variances, 0.0)))[:, kept])


def refined_lens(camera: Camera, change: Array, covariance: Array) -> Camera:
    """The camera with its nine intrinsics changed by (9,), and their covariance (9, 9)."""
    other = camera_of(vector_of(camera) + change, camera.size)
    return replace(camera, K=other.K, distortion=other.distortion, lens_covariance=covariance)
