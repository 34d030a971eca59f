"""Test whether another marker size fits the corners better than the stated one, given the markers' spacing.

A marker size that is wrong by 1 mm shifts the board's height by 24 mm (docs/sources.md, "Pose of a board"). The pose
fit shows it only by larger residuals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.se3 import moved
from vision.boards.pose_fit import Fit
from vision.camera.model import Camera
from vision.camera.projection import Projection

_STEPS = 8
DETERMINED = 1e-9  # smallest ratio of the information's eigenvalues, in m and rad


@dataclass(frozen=True)
class MarkerSize:
    """The best-fitting marker size.

    Attributes:
        size: edge of the black square, m.
        sigma: its standard deviation, from the remaining residuals, m.
        rms_px: residual of the mean corners with that size, per coordinate.
    """

    size: float
    sigma: float
    rms_px: float


def fit_marker_size(board: Board, fit: Fit, camera: Camera, least_sigma_px: float) -> MarkerSize | None:
    """Fit pose and marker size together to the mean corners of `fit`; None if the fit fails.

    Args:
        board: whose stated size is tested.
        fit: of the pose with the stated size.
        camera: the camera.
        least_sigma_px: smallest standard deviation of a mean corner.
    """
    outlines = board.marker_corners()
    centres = outlines.mean(axis=1, keepdims=True)
    scale, T = 1.0, fit.T_camera_board
    root = np.sqrt(fit.shares)[:, None]
    J, residual = np.empty(0), np.empty(0)
    for _ in range(_STEPS):
        points = (centres + scale * (outlines - centres)).reshape(-1, 3)
        seen = Projection(camera, T, points)
        by_scale = seen.by_point @ (outlines - centres).reshape(-1, 3)[..., None]
        J = (root[..., None] * np.concatenate([seen.by_target, by_scale], axis=-1)).reshape(-1, 7)
        residual = fit.mean_px - seen.pixels
        if not np.isfinite(residual).all():
            return None
        step, *_ = np.linalg.lstsq(J, (root * residual).reshape(-1), rcond=None)
        T = moved(T, step[:6])
        scale += float(step[6])
    information = J.T @ J
    least, *_, most = np.linalg.eigvalsh(information)
    if least < DETERMINED * most:
        return None
    variance = max(float(((root * residual) ** 2).sum()) / (fit.freedom - 1), least_sigma_px**2)
    sigma = float(np.sqrt(variance * np.linalg.inv(information)[6, 6]))
    rms_px = float(np.sqrt(np.mean(residual[fit.shares > 0.0] ** 2)))
    return MarkerSize(board.marker_size * scale, board.marker_size * sigma, rms_px)
