"""Verdict on a camera calibration: whether it is accurate enough, and if not, why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from arm.se3 import Indices
from calib.camera import score_tests
from calib.camera.result import CameraCalibration
from calib.camera.score_tests import ErrorHypothesis
from calib.camera.view_selection import left_out
from calib.model.intrinsics import NAMES, vector_of

BIASED = 1 / 3  # of the limit: a model error that moves the work points further is a reason to refuse
HELD_OUT = 1.3  # largest error of held-out corners, relative to that of used corners
LONG_S = 3600.0  # over a longer time the camera may have changed
COVERED = 0.6  # smallest fraction of the image
SPREAD = 0.1  # distances that differ relatively by less count as equal
GLARING = 0.05  # largest fraction of saturated white
SCATTERED = 2.5  # largest scatter of the five groups' fits, relative to the prediction
CELLS = (8, 5)


def with_verdict(c: CameraCalibration) -> CameraCalibration:
    """Return the calibration with its verdict; each reason gives value, limit and remedy."""
    untilted = list(_too_little_tilt(c))
    if untilted:  # then no distance is meaningful
        reasons = (*_too_few_views(c), *untilted, *_no_inverse(c))
        return replace(c, reasons=reasons, remarks=tuple(_images(c)), next=())
    if few := tuple(_too_few_views(c)):  # what else may be wrong cannot be told from so few
        return replace(c, reasons=few, remarks=tuple(_images(c)))
    reasons = (*_no_inverse(c), *_target(c), *_accuracy(c))
    return replace(c, reasons=reasons, remarks=(*_images(c), *_distances(c), *_intrinsics(c)))


def coverage(c: CameraCalibration) -> float:
    """Fraction of the image's `CELLS` that contain corners of used views, of those whose middle matters, 0 to 1."""
    left, top, right, bottom = c.work.region or (0.0, 0.0, *c.camera.size)
    (columns, rows), (width, height) = CELLS, c.camera.size
    x, y = (np.arange(columns) + 0.5) * width / columns, (np.arange(rows) + 0.5) * height / rows
    matters = ((top <= y) & (y <= bottom))[:, None] & ((left <= x) & (x <= right))
    return float((cells(c) > 0)[matters].mean()) if matters.any() else 1.0


def where(c: CameraCalibration) -> str:
    """The part of the image that matters, in words."""
    if c.work.region is None:
        return "the image"
    left, top, right, bottom = c.work.region
    return f"the image from {left:g}, {top:g} to {right:g}, {bottom:g} px"


def cells(c: CameraCalibration) -> Indices:
    """Number of corners of used views in each cell of the image, rows by columns."""
    corners = [v.photo.view.corners_px for v in c.used if v.photo.view is not None]
    x, y = np.clip((np.concatenate(corners) + 0.5) / c.camera.size, 0.0, 1.0).T
    count, *_ = np.histogram2d(y, x, bins=CELLS[::-1], range=((0.0, 1.0), (0.0, 1.0)))
    return np.asarray(count, dtype=np.intp)


def _too_few_views(c: CameraCalibration) -> Iterator[str]:
    if len(c.used) < c.limits.views:
        left = [v for v in c.views if not v.used]
        why = f" ({left_out([v.photo.name for v in left], [v.why_not for v in left])})" if left else ""
        more = c.limits.views - len(c.used)
        yield (
            f"{len(c.used)} views are usable, at least {c.limits.views} are needed{why}: take {more} or more others, "
            "tilted by 20 to 45 deg, also near the edges of the image"
        )


def _too_little_tilt(c: CameraCalibration) -> Iterator[str]:
    if c.lifted:
        return
    tilts = np.array([v.tilt for v in c.used])
    tilted = int((tilts >= c.limits.tilt).sum())
    if tilted < min(c.limits.tilted, len(tilts)):  # if all are, only views are missing, which is told
        known = ""
        if c.focal_interval is not None:
            known = " (fx is within {:.0f} to {:.0f} px, 95 %)".format(*c.focal_interval)
        yield (
            f"{tilted} of {len(tilts)} views are tilted by {np.degrees(c.limits.tilt):.0f} deg or more, at least "
            f"{c.limits.tilted} are needed (the most is {np.degrees(tilts.max()):.0f} deg): views that face the camera "
            f"do not separate focal length from distance{known}; tilt the target by 20 to 45 deg, or put it on a "
            "box of known height for one more image and give --lift IMAGE=HEIGHT_MM"
        )


def _no_inverse(c: CameraCalibration) -> Iterator[str]:
    """The distortion polynomial is not monotonic where no view has a corner."""
    if c.work.blind:
        k1, k2, _, _, k3 = c.camera.distortion
        yield (
            f"the fitted distortion has no inverse in {100 * c.work.blind:.0f} % of the image, towards its corners: "
            f"k1 {k1:.3g}, k2 {k2:.3g}, k3 {k3:.3g} are extrapolated from the {100 * coverage(c):.0f} % in which "
            "corners lie; show the target there too, or hold k2 and k3"
        )


def _target(c: CameraCalibration) -> Iterator[str]:
    share = marker_share(c)
    if share is not None and abs(share * c.target.square / c.target.marker - 1.0) > c.limits.marker_share:
        yield (
            f"its markers measure {1e3 * share * c.target.square:.2f} mm if its squares are "
            f"{1e3 * c.target.square:g} mm, but the target file has {1e3 * c.target.marker:g} mm: measure both "
            "on the print and correct the file (the square size scales all distances)"
        )
    deciding = next((s for s in c.hypotheses if _decides(c, s)), None)
    if deciding is not None:  # a strong model error can make the others look present
        yield f"{describe(deciding)}; it moves the work points by {1e3 * _shift(c, deciding):.2f} mm"


def marker_share(c: CameraCalibration) -> float | None:
    """Marker size in squares, median over the used views; None without markers."""
    shares = [v.photo.quality.marker_share for v in c.used if v.photo.quality is not None]
    shares = [s for s in shares if np.isfinite(s)]
    return float(np.median(shares)) if shares and c.target.marker > 0.0 else None


def _shift(c: CameraCalibration, hypothesis: ErrorHypothesis) -> float:
    return float(np.sqrt(np.mean(c.work.shifts(hypothesis.intrinsics_change) ** 2)))


def _decides(c: CameraCalibration, hypothesis: ErrorHypothesis) -> bool:
    # a bias of the corners is covered by the standard deviations, as hand-eye calibration does it
    named = hypothesis.sure and hypothesis.name != score_tests.BIASED_CORNERS
    return named and 1e3 * _shift(c, hypothesis) > BIASED * c.limits.work_mm


def describe(hypothesis: ErrorHypothesis) -> str:
    """Describe a model error in words, with its amount."""
    amount, sigma = hypothesis.amount, hypothesis.sigma
    match hypothesis.name:
        case "bent target":
            return (
                f"the target is bent by {1e3 * abs(amount):.2f} +- {1e3 * sigma:.2f} mm: glue it to a flat, "
                "stiff plate"
            )
        case "stretched target":
            return (
                f"the target's rows are {100 * amount:+.2f} +- {100 * sigma:.2f} % further apart than its columns: "
                "print it without scaling and measure both"
            )
        case score_tests.BIASED_CORNERS:
            nearer = "nearer to" if amount > 0.0 else "farther from"
            return (
                f"corners are seen {abs(amount):.3f} +- {sigma:.3f} px {nearer} the middle of each view than they are: "
                "use even light, a shorter exposure and sharp focus"
            )
        case _:
            return (
                f"the focal length changes by {100 * amount:+.2f} +- {100 * sigma:.2f} % from the first view to the "
                "last: lock focus and zoom, and let the camera warm up"
            )


def _accuracy(c: CameraCalibration) -> Iterator[str]:
    worst = 1e3 * float(c.work_sigmas.max())
    helps = f"; take a view {c.next[0].words}" if c.next else ""
    of_region = "" if c.work.region is None else f" in {where(c)}"
    or_less = (
        ", or give the part of the image that matters with --work-region" if c.work.region is None else ""
    )
    if worst > c.limits.work_mm:
        yield (
            f"points at {1e3 * c.work.near:.0f} to {1e3 * c.work.far:.0f} mm{of_region} have a standard deviation of "
            f"{worst:.3g} mm, the limit is {c.limits.work_mm:g} mm{helps}{or_less}"
        )
    if c.corner_sigma > c.limits.corner_px:
        yield (
            f"the corner error is {c.corner_sigma:.2f} px, the limit is {c.limits.corner_px:g} px: is the target the "
            "one in the target file, and are the images sharp and the target flat?"
        )
    if c.cross.sigma_px > HELD_OUT * c.corner_sigma:
        yield (
            f"the corner error of held-out views is {c.cross.sigma_px:.3f} px, that of the used ones "
            f"{c.corner_sigma:.3f} px: the views do not determine the intrinsics{helps}"
        )


def _images(c: CameraCalibration) -> Iterator[str]:
    covered = coverage(c)
    if covered < COVERED:
        yield (
            f"corners lie in {100 * covered:.0f} % of {where(c)}; the rest is extrapolated: show the target near the "
            "edges too"
        )
    overexposed = [
        v.photo.name for v in c.used if v.photo.quality is not None and v.photo.quality.saturated > GLARING
    ]
    if overexposed:
        yield f"white is overexposed in {', '.join(overexposed)}: shorten the exposure"
    times = [v.photo.taken_s for v in c.used if v.photo.taken_s is not None]
    if len(times) == len(c.used) and max(times) - min(times) > LONG_S:
        yield f"the views span {np.ptp(times) / 3600.0:.1f} h: the camera must not have been touched in between"


def _distances(c: CameraCalibration) -> Iterator[str]:
    distances = [v.distance for v in c.used]
    near, far = min(distances), max(distances)
    views = f"{1e3 * near:.0f} to {1e3 * far:.0f} mm away: show the target at"
    if far < (1.0 + SPREAD) * near:
        yield f"all views are {views} more distances"
    if c.work.near < (1.0 - SPREAD) * near or c.work.far > (1.0 + SPREAD) * far:
        yield (
            f"the working distance is {1e3 * c.work.near:.0f} to {1e3 * c.work.far:.0f} mm, the views are {views} the "
            "working distance"
        )


def _intrinsics(c: CameraCalibration) -> Iterator[str]:
    if any(_decides(c, s) for s in c.hypotheses):
        return  # then all intrinsics are doubtful, and the reason explains it
    for s in c.hypotheses:
        if s.sure:
            yield f"{describe(s)} (it moves the work points by {1e3 * _shift(c, s):.3f} mm; their error includes this)"
    for name, view in c.undetermined.items():
        index = NAMES.index(name)
        helps = f"; the most informative view is {view.words}" if view else ""
        yield (
            f"{name} = {vector_of(c.camera)[index]:.3g} +- {c.sigmas[index]:.2g} is poorly determined by these views "
            f"(the error at the work points includes this){helps}"
        )
    jackknife, predicted = (float(np.sqrt(np.mean(s**2))) for s in (c.cross.work_sigmas, c.work_sigmas))
    if jackknife > SCATTERED * predicted:
        yield (
            f"groups of views scatter by {1e3 * jackknife:.3f} mm at the work points, {1e3 * predicted:.3f} mm is "
            "expected: the corner errors are not independent"
        )
