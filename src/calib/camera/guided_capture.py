"""Taking views of a target with guidance: what to show next, whether a frame counts, and when it is enough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array
from calib.camera.calibrate import calibrate_camera
from calib.camera.result import CalibrationLimits, CameraCalibration
from calib.camera.view_selection import LEAST_BLUR_PX, LEAST_CONTRAST, SATURATED, TargetPhoto
from vision.targets.target import FEWEST_CORNERS, Target, TargetView

STILL_PX = 0.5  # corners of two frames of a target that is held still lie this near to each other
NEW_SHARE = 0.01  # of the image's width by which a new view must differ from every view before
ENOUGH_VIEWS = 16  # after so many, a number that hardly matters at the work points need not be known
GOOD = 1 / 3  # of the limit at the work points: who takes views anyway can have more than just enough
FIRST = (
    "in the middle of the image, filling two thirds of it, facing the camera",
    "in the middle of the image, its left edge some 30 deg nearer",
    "in the middle of the image, its right edge some 30 deg nearer",
    "in the middle of the image, its upper edge some 30 deg nearer",
    "in the middle of the image, its lower edge some 30 deg nearer",
)


@dataclass(frozen=True, eq=False)
class Advice:
    """What to do now.

    Attributes:
        words: where to hold the target.
        T_camera_target: the same as a pose, once the lens is known roughly; else None.
        done: whether the views are enough.
        work_mm: worst standard deviation at the work points so far, mm; None while it is not known.
    """

    words: str
    T_camera_target: Array | None
    done: bool
    work_mm: float | None


class GuidedViews:
    """The views taken so far, and what they still lack.

    Args:
        target: that is shown.
        size: of the images, px.
        work: nearest and farthest distance of the work, m; default: those of the views.
        limits: when it is enough.
    """

    def __init__(
        self,
        target: Target,
        size: tuple[int, int],
        work: tuple[float, float] | None = None,
        limits: CalibrationLimits | None = None,
    ) -> None:
        self.photos: list[TargetPhoto] = []
        self._advice: Advice | None = None
        self._target, self._size, self._work = target, size, work
        self._limits = limits or CalibrationLimits()
        self._last: TargetView | None = None

    def consider(self, photo: TargetPhoto) -> str:
        """Take a frame as a view if it is one; "" if it was taken, else what is wrong with it for a person."""
        last, self._last = self._last, photo.view
        if photo.view is None or photo.quality is None:
            return "no target in view"
        if last is None or _shift(photo.view, last) > STILL_PX:
            return "hold it still"
        if photo.quality.contrast < LEAST_CONTRAST:
            return "too dark"
        if photo.quality.saturated > SATURATED:
            return "overexposed"
        if photo.quality.blur_px > LEAST_BLUR_PX:
            return f"blurred ({photo.quality.blur_px:.1f} px): hold it still, or focus"
        known = [p.view for p in self.photos if p.view is not None]
        if any(_shift(photo.view, view) < NEW_SHARE * self._size[0] for view in known):
            return "shown before"
        self.photos.append(photo)
        self._advice = None
        return ""

    @property
    def advice(self) -> Advice:
        """What to do now."""
        if self._advice is None:
            self._advice = self._next()
        return self._advice

    def calibration(self) -> CameraCalibration:
        """The lens by the views so far.

        Raises:
            CalibrationRefused: they are too few.
        """
        return calibrate_camera(self.photos, self._target, self._size, work=self._work, limits=self._limits)

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


def _shift(view: TargetView, other: TargetView) -> float:
    """How far the corners that both have lie apart, median px; infinite if they have few in common."""
    common, here, there = np.intersect1d(view.ids, other.ids, return_indices=True)
    if len(common) < FEWEST_CORNERS:
        return float("inf")
    return float(np.median(np.linalg.norm(view.corners_px[here] - other.corners_px[there], axis=1)))
