"""A camera's calibration as a value: the lens, how well it is known, and what became of every photograph."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from arm.errors import CalibrationRefused
from arm.se3 import Array
from calib.camera.cross_validation import CrossCheck
from calib.camera.next_views import NextView
from calib.camera.score_tests import Suspect
from calib.camera.view_selection import TargetPhoto
from calib.camera.working_volume import WorkPoints
from vision.camera.model import Camera
from vision.targets.target import Target


@dataclass(frozen=True)
class CalibrationLimits:
    """When a calibration is refused.

    Attributes:
        work_mm: largest standard deviation at a work point, mm; a pocket catches a cube that is 2 mm off.
        corner_px: largest error of a corner, px.
        views: fewest views that are used.
        tilted: fewest views that are tilted by at least `tilt`.
        tilt: rad.
        marker_share: largest deviation of the markers' size from the target file, a part of it.
        most_views: more are not used but held out.
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
    """A photograph after the calibration.

    Attributes:
        photo: as it was given.
        used: whether the lens rests on it.
        why_not: why it was left out; "" where it is used.
        T_camera_target: 4x4, or None where there is no pose.
        residual: (n, 2) px of the corners of `photo.view`, measured minus projected; None without a pose.
        dropped: (n,) corners that were left out as wrong.
        distance: of its corners' middle along the camera's axis, m; NaN without a pose.
    """

    photo: TargetPhoto
    used: bool
    why_not: str
    T_camera_target: Array | None = None
    residual: Array | None = None
    dropped: npt.NDArray[np.bool_] | None = None
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


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A lens, how well it is known, and whether it may be used.

    Attributes:
        camera: at the origin.
        covariance: (9, 9), order of `calib.model.intrinsics.NAMES`; zero rows for numbers that were held.
        free: (9,) which were fitted.
        corner_sigma: error of a corner's coordinate, px, without bias.
        views: every photograph in the order given.
        target: that was shown.
        work: the points where errors count.
        work_sigmas: (n,) m standard deviation across the line of sight at each, with what suspects that are sure move
            it by.
        cross: what held-out views say.
        suspects: troubles, the strongest first.
        undetermined: numbers of the lens that the views say too little of, each with the view that would tell most.
        next: views that would help most at the work points.
        reasons: why it is refused; none if it is accepted.
        remarks: what else a person should know.
    """

    camera: Camera
    covariance: Array
    free: npt.NDArray[np.bool_]
    corner_sigma: float
    views: tuple[CalibrationView, ...]
    target: Target
    work: WorkPoints
    work_sigmas: Array
    cross: CrossCheck
    suspects: tuple[Suspect, ...]
    undetermined: dict[str, NextView | None]
    next: tuple[NextView, ...]
    reasons: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    limits: CalibrationLimits = field(default_factory=CalibrationLimits)

    @property
    def accepted(self) -> bool:
        """Whether it may be used."""
        return not self.reasons

    @property
    def sigmas(self) -> Array:
        """Standard deviations (9,) of the lens."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def used(self) -> list[CalibrationView]:
        """The views that the lens rests on."""
        return [view for view in self.views if view.used]

    def require(self) -> None:
        """Check that it may be used.

        Raises:
            CalibrationRefused: with every reason.
        """
        if self.reasons:
            raise CalibrationRefused(
                "; ".join(self.reasons),
                reasons=list(self.reasons),
                work_sigma_m=float(self.work_sigmas.max()),
                corner_sigma_px=self.corner_sigma,
            )
