"""Select the views for a calibration, and give a reason for each view that is left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array, Bools, Indices
from calib.recordings.points import on_a_line
from vision.camera.model import Image
from vision.targets.quality import Quality, measure_quality
from vision.targets.target import FEWEST_CORNERS, TargetFinder, TargetView

# a view is blurred above this multiple of the median blur of the sharpest quarter, within these limits
BLURRED, LEAST_BLUR_PX, MOST_BLUR_PX = 2.0, 1.5, 4.0
LEAST_CONTRAST = 25.0  # grey levels
SATURATED = 0.5  # largest fraction of saturated white
MOST_NAMED = 3  # images of one reason, before their number stands for them
THINNEST = 0.02  # width of a view's corners, relative to their length: thinner is one line
SAME_PX = 4.0  # views whose corners differ by less are the same view
# an outlying view exceeds all three:
OUTLIER_VIEW = 4.0  # standard deviations of a view's variance above that of the others
OUTLIER_SIGMA = 2.5  # times the corner error of the others: tilt, light and sharpness differ too
LEAST_OUTLIER_RMS_PX = 0.1  # a target that moved gives more
# an outlying corner exceeds both:
OUTLIER_CORNER = 6.0  # standard deviations
LEAST_OUTLIER_PX = 0.25  # correct detections may err by as much


@dataclass(frozen=True, eq=False)
class TargetPhoto:
    """An image taken for a calibration.

    Attributes:
        name: of its file.
        view: the detected target, or None.
        quality: of the detection, or None.
        taken_s: time on a clock common to all images, s; None if unknown.
    """

    name: str
    view: TargetView | None
    quality: Quality | None
    taken_s: float | None = None

    @classmethod
    def of(cls, name: str, image: Image, finder: TargetFinder, taken_s: float | None = None) -> TargetPhoto:
        """Detect the target in an image, and measure the quality of the detection."""
        view = finder.find(image)
        quality = None if view is None else measure_quality(image, finder.target, view)
        return cls(name, view, quality, taken_s)


def unusable(photos: Sequence[TargetPhoto]) -> list[str]:
    """For each image, return why it is unusable, or "" if it is usable."""
    blurs = sorted(
        p.quality.blur_px for p in photos if p.quality is not None and np.isfinite(p.quality.blur_px)
    )
    sharp = float(np.median(blurs[: max(1, len(blurs) // 4)])) if blurs else 0.0
    limit = min(max(BLURRED * sharp, LEAST_BLUR_PX), MOST_BLUR_PX)
    reasons = []
    kept: list[TargetPhoto] = []
    for photo in photos:
        reason = _why_unusable(photo, limit, sharp) or _same_as(photo, kept)
        reasons.append(reason)
        if not reason:
            kept.append(photo)
    return reasons


def left_out(names: Sequence[str], reasons: Sequence[str]) -> str:
    """Return for a message which images are left out and why: each reason once, "" where none is."""
    by_reason: dict[str, list[str]] = {}
    for name, reason in zip(names, reasons, strict=True):
        if reason:
            by_reason.setdefault(reason, []).append(name)
    return "; ".join(f"{_some(images)}: {reason}" for reason, images in by_reason.items())


def _some(names: Sequence[str]) -> str:
    if len(names) <= MOST_NAMED:
        return ", ".join(names)
    return f"{names[0]} and {len(names) - 1} more"


def _why_unusable(photo: TargetPhoto, blur_limit: float, sharp: float) -> str:
    if photo.view is None or photo.quality is None:
        return (
            f"fewer than {FEWEST_CORNERS} corners of the target detected: it is hidden, cut off (a checkerboard must "
            "be whole), or in view twice"
        )
    if on_a_line(photo.view.corners_px, THINNEST):
        return "all detected corners lie on one line"
    if photo.quality.contrast < LEAST_CONTRAST:
        return (
            f"contrast of {photo.quality.contrast:.0f} grey levels, less than {LEAST_CONTRAST:.0f}: too dark"
        )
    if photo.quality.saturated > SATURATED:
        return f"{100 * photo.quality.saturated:.0f} % of its white is overexposed"
    if photo.quality.blur_px > blur_limit:
        return f"blurred: edges are {photo.quality.blur_px:.1f} px wide, in the sharpest views {sharp:.1f} px"
    return ""


def _same_as(photo: TargetPhoto, kept: Sequence[TargetPhoto]) -> str:
    for other in kept:
        if photo.view and other.view and corner_shift(photo.view, other.view) < SAME_PX:
            return f"shows the target in the same place as {other.name} (move and tilt it between images)"
    return ""


def corner_shift(view: TargetView, other: TargetView) -> float:
    """Median shift of the corners in both views, px; infinite if there are too few."""
    common, here, there = np.intersect1d(view.ids, other.ids, return_indices=True)
    if len(common) < FEWEST_CORNERS:
        return float("inf")
    return float(np.median(np.linalg.norm(view.corners_px[here] - other.corners_px[there], axis=1)))


def outlying_views(variances: Array, counts: Indices) -> Bools:
    """Views whose residuals are significantly larger than those of the others, (n,).

    Args:
        variances: mean square residual of each view, px^2.
        counts: degrees of freedom of each view, 2 corners - 6.
    """
    typical = float(np.median(variances))
    chance = 1.0 + OUTLIER_VIEW * np.sqrt(2.0 / np.maximum(counts, 1))
    limit = typical * np.maximum(chance, OUTLIER_SIGMA**2)
    return np.asarray(variances > np.maximum(limit, LEAST_OUTLIER_RMS_PX**2))


def outlying_corner(residual: Array, sigma: float) -> int | None:
    """Return the worst corner of a view if it is an outlier; only one, as it distorts the residuals of the others."""
    off = np.abs(residual).max(axis=1)
    worst = int(np.argmax(off))
    return worst if off[worst] > max(OUTLIER_CORNER * sigma, LEAST_OUTLIER_PX) else None
