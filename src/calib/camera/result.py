"""Result of a camera calibration: intrinsics, their uncertainty, and what happened to every image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.former import renamed_arguments
from arm.se3 import Array, Bools
from calib.camera.cross_validation import CrossValidation
from calib.camera.next_views import NextView
from calib.camera.score_tests import ErrorHypothesis
from calib.camera.view_selection import TargetPhoto
from calib.camera.working_volume import WorkingVolume
from calib.model.verdict import Judged
from vision.camera.model import Camera
from vision.targets.target import Target


@dataclass(frozen=True)
class CalibrationLimits:
    """Limits for accepting a calibration.

    Attributes:
        work_mm: largest standard deviation at a work point, mm; a pocket catches a cube that is 2 mm off.
        corner_px: largest corner error, px.
        views: fewest views used.
        tilted: fewest views tilted by at least `tilt`.
        tilt: rad.
        marker_share: largest relative deviation of the marker size from that in the target file.
        most_views: largest number of views in the fit; the others are held out.
    """

    work_mm: float = 0.3
    corner_px: float = 1.0
    views: int = 8
    tilted: int = 4
    tilt: float = np.radians(10.0)
    marker_share: float = 0.01
    most_views: int = 40


@dataclass(frozen=True, eq=False)
class CalibrationView:
    """An image after the calibration.

    Attributes:
        photo: the input.
        used: whether the fit uses it.
        why_not: why it was left out; "" if it is used.
        T_camera_target: 4x4, or None without a pose.
        residual: (n, 2) px of the corners of `photo.view`, measured minus projected; None without a pose.
        dropped: (n,) corners rejected as outliers.
        distance: mean depth of its corners along the optical axis, m; NaN without a pose.
    """

    photo: TargetPhoto
    used: bool
    why_not: str
    T_camera_target: Array | None = None
    residual: Array | None = None
    dropped: Bools | None = None
    distance: float = float("nan")

    @property
    def rms_px(self) -> float:
        """Root mean square residual per coordinate, without dropped corners; NaN without a pose."""
        if self.residual is None or self.dropped is None or self.dropped.all():
            return float("nan")
        return float(np.sqrt(np.mean(self.residual[~self.dropped] ** 2)))

    @property
    def tilt(self) -> float:
        """Angle between the target and the image plane, rad; NaN without a pose."""
        if self.T_camera_target is None:
            return float("nan")
        return float(np.arccos(np.clip(abs(self.T_camera_target[2, 2]), 0.0, 1.0)))


@renamed_arguments(suspects="hypotheses")
@dataclass(frozen=True, eq=False)
class CameraCalibration(Judged):
    """Calibrated intrinsics, their uncertainty, and whether they may be used.

    Attributes:
        camera: at the origin.
        covariance: (9, 9), order of `calib.model.intrinsics.NAMES`; zero rows for intrinsics that were held.
        free: (9,) intrinsics that were fitted.
        corner_sigma: unbiased error of a corner coordinate, px.
        views: every image, in input order.
        target: shown in the views.
        work: the points where errors count.
        work_sigmas: standard deviation of each across the line of sight, (n,) m, with the shifts due to model errors
            that are present.
        cross: result of cross-validation.
        hypotheses: tested model errors, the most significant first.
        undetermined: intrinsics that the views do not determine, each with its most informative next view.
        next: views that would most reduce the error at the work points.
        limits: for acceptance.
        focal_interval: 95 % of the focal length, px, where too few views are tilted or some are lifted; else None.
        lifted: whether the fit uses views on a box of known height.
    """

    camera: Camera
    covariance: Array
    free: Bools
    corner_sigma: float
    views: tuple[CalibrationView, ...]
    target: Target
    work: WorkingVolume
    work_sigmas: Array
    cross: CrossValidation
    hypotheses: tuple[ErrorHypothesis, ...]
    undetermined: dict[str, NextView | None]
    next: tuple[NextView, ...]
    limits: CalibrationLimits
    focal_interval: tuple[float, float] | None = None
    lifted: bool = False

    @property
    def sigmas(self) -> Array:
        """Standard deviations (9,) of the intrinsics."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def used(self) -> list[CalibrationView]:
        """The views that the fit uses."""
        return [view for view in self.views if view.used]
