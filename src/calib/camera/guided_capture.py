"""Guided capture of target views: what to show next, which frames count, and when to stop."""

from __future__ import annotations

from dataclasses import dataclass

from arm.errors import CalibrationRefused
from arm.se3 import Array
from calib.camera.calibrate import calibrate_camera
from calib.camera.result import CalibrationLimits, CameraCalibration
from calib.camera.view_selection import LEAST_BLUR_PX, LEAST_CONTRAST, SATURATED, TargetPhoto, corner_shift
from vision.camera.model import Region
from vision.targets.target import Target, TargetView

STILL_PX = 0.5  # largest shift of the corners between two frames of a target held still
NEW_SHARE = 0.01  # of the image width: least difference between a new view and all previous ones
ENOUGH_VIEWS = 16  # after these, intrinsics that hardly matter at the work points may stay undetermined
GOOD = 1 / 3  # of the limit at the work points; a few more views than for acceptance reach it
_EDGES = ("left", "right", "upper", "lower")
FIRST = (
    "in the middle of the image, filling two thirds of it, facing the camera",
    *(f"in the middle of the image, tilted some 30 deg with its {edge} edge nearer" for edge in _EDGES),
)


@dataclass(frozen=True, eq=False)
class Advice:
    """What to do next.

    Attributes:
        words: where to hold the target.
        T_camera_target: the same as a pose; None until rough intrinsics are known.
        done: whether the views suffice.
        work_mm: largest standard deviation at the work points so far, mm; None if unknown.
    """

    words: str
    T_camera_target: Array | None
    done: bool
    work_mm: float | None


class GuidedViews:
    """The views taken so far, and what is still missing.

    Args:
        target: shown in the views.
        size: of the images, px.
        work: nearest and farthest working distance, m; default: those of the views.
        limits: for acceptance.
        region: part of the image that matters, px; default: all of it.
    """

    def __init__(
        self,
        target: Target,
        size: tuple[int, int],
        work: tuple[float, float] | None = None,
        limits: CalibrationLimits | None = None,
        region: Region | None = None,
    ) -> None:
        self.photos: list[TargetPhoto] = []
        self._advice: Advice | None = None
        self._target, self._size, self._work, self._region = target, size, work, region
        self._limits = limits or CalibrationLimits()
        self._last: TargetView | None = None

    def consider(self, photo: TargetPhoto) -> str:
        """Add a frame if it is usable; return "" if it was added, else the reason in words."""
        last, self._last = self._last, photo.view
        if photo.view is None or photo.quality is None:
            return "no target in view"
        if last is None or corner_shift(photo.view, last) > STILL_PX:
            return "hold it still"
        if photo.quality.contrast < LEAST_CONTRAST:
            return "too dark"
        if photo.quality.saturated > SATURATED:
            return "overexposed"
        if photo.quality.blur_px > LEAST_BLUR_PX:
            return f"blurred ({photo.quality.blur_px:.1f} px): hold it still, or focus"
        known = [p.view for p in self.photos if p.view is not None]
        if any(corner_shift(photo.view, view) < NEW_SHARE * self._size[0] for view in known):
            return "shown before"
        self.photos.append(photo)
        self._advice = None
        return ""

    @property
    def advice(self) -> Advice:
        """What to do next."""
        if self._advice is None:
            self._advice = self._next()
        return self._advice

    def calibration(self) -> CameraCalibration:
        """Calibrate from the views so far, quickly: where too few are tilted, without the focal length's interval.

        Raises:
            CalibrationRefused: too few views.
        """
        return calibrate_camera(
            self.photos,
            self._target,
            self._size,
            work=self._work,
            limits=self._limits,
            flat=False,
            region=self._region,
        )

    def _next(self) -> Advice:
        if len(self.photos) < len(FIRST):
            return Advice(FIRST[len(self.photos)], None, False, None)
        try:
            c = self.calibration()
        except CalibrationRefused:
            return Advice(FIRST[len(self.photos) % len(FIRST)], None, False, None)
        worst = 1e3 * float(c.work_sigmas.max())
        if not c.next:  # not tilted enough
            return Advice(FIRST[1 + len(self.photos) % 4], None, False, None)
        lacking = [view for view in c.undetermined.values() if view is not None]
        good = c.accepted and worst < GOOD * self._limits.work_mm
        enough = (good and not lacking) or (c.accepted and len(self.photos) >= ENOUGH_VIEWS)
        view = lacking[0] if good and lacking else c.next[0]
        return Advice(view.words, view.T_camera_target, enough, worst)
