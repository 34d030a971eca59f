"""Verdict on a camera calibration: whether it is accurate enough, and if not, why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm.se3 import Indices
from calib.camera.result import CameraCalibration
from calib.camera.score_tests import ErrorHypothesis
from calib.model.intrinsics import NAMES, vector_of

BIASED = 1 / 3  # share of the limit: a model error that moves the work points further is a reason to refuse
HELD_OUT = 1.3  # largest error of held-out corners, relative to that of the used ones
LONG_S = 3600.0  # over a longer time the camera may have changed
COVERED = 0.6  # share of the image
SPREAD = 0.1  # distances that differ relatively by less count as equal
GLARING = 0.05  # share of saturated white
SCATTERED = 2.5  # largest scatter of the five groups' fits, relative to the prediction
CELLS = (8, 5)


def with_verdict(c: CameraCalibration) -> CameraCalibration:
    """Return the calibration with its verdict; each reason gives value, limit and remedy."""
    untilted = _too_little_tilt(c)
    if untilted:  # then no distance is meaningful
        reasons = (*_too_few_views(c), untilted, *_no_inverse(c))
        return replace(c, reasons=reasons, remarks=tuple(_photographs(c)), next=())
    reasons = (*_too_few_views(c), *_no_inverse(c), *_target(c), *_accuracy(c))
    return replace(c, reasons=reasons, remarks=(*_photographs(c), *_distances(c), *_lens(c)))


def coverage(c: CameraCalibration) -> float:
    """Share of the image's `CELLS` in which used views have corners, 0 to 1."""
    return float((cells(c) > 0).mean())


def cells(c: CameraCalibration) -> Indices:
    """Number of corners of used views in each cell of the image, rows by columns."""
    columns, rows = CELLS
    count = np.zeros((rows, columns), dtype=np.intp)
    for view in c.used:
        if view.photo.view is None:
            continue
        at = (view.photo.view.corners_px + 0.5) / c.camera.size
        column = np.clip((at[:, 0] * columns).astype(np.intp), 0, columns - 1)
        row = np.clip((at[:, 1] * rows).astype(np.intp), 0, rows - 1)
        np.add.at(count, (row, column), 1)
    return count


def _too_few_views(c: CameraCalibration) -> list[str]:
    if len(c.used) >= c.limits.views:
        return []
    left = [f"{v.photo.name}: {v.why_not}" for v in c.views if not v.used]
    return [
        f"{len(c.used)} views are usable, at least {c.limits.views} are needed"
        + (f" ({'; '.join(left)})" if left else "")
    ]


def _too_little_tilt(c: CameraCalibration) -> str:
    tilts = np.array([v.tilt for v in c.used])
    tilted = int((tilts >= c.limits.tilt).sum())
    if tilted >= c.limits.tilted:
        return ""
    return (
        f"{tilted} of {len(tilts)} views are tilted by {np.degrees(c.limits.tilt):.0f} deg or more, at least "
        f"{c.limits.tilted} are needed (the most is {np.degrees(tilts.max()):.0f} deg): views that face the camera do "
        "not separate focal length from distance; tilt the target by 20 to 45 deg"
    )


def _no_inverse(c: CameraCalibration) -> list[str]:
    """The distortion polynomial is not monotonic where no corner was seen."""
    if not c.work.blind:
        return []
    return [
        f"the fitted distortion has no inverse in {100 * c.work.blind:.0f} % of the image, towards its corners: "
        f"k1 {c.camera.distortion[0]:.3g}, k2 {c.camera.distortion[1]:.3g}, k3 {c.camera.distortion[4]:.3g} are "
        f"extrapolated from the {100 * coverage(c):.0f} % in which corners lie; show the target there too, or hold "
        "k2 and k3"
    ]


def _target(c: CameraCalibration) -> list[str]:
    reasons = []
    share = marker_share(c)
    if share is not None:
        off = share * c.target.square / c.target.marker - 1.0
        if abs(off) > c.limits.marker_share:
            reasons.append(
                f"its markers measure {1e3 * share * c.target.square:.2f} mm if its squares are "
                f"{1e3 * c.target.square:g} mm, but the target file has {1e3 * c.target.marker:g} mm: measure both "
                "on the print and correct the file (the square size scales all distances)"
            )
    deciding = [s for s in c.hypotheses if _decides(c, s)]
    for hypothesis in deciding[:1]:  # a strong model error can make the others look present
        reasons.append(
            f"{describe(hypothesis)}; it moves the work points by {1e3 * _shift(c, hypothesis):.2f} mm"
        )
    return reasons


def marker_share(c: CameraCalibration) -> float | None:
    """Marker size in squares, median over the used views; None without markers."""
    shares = [v.photo.quality.marker_share for v in c.used if v.photo.quality is not None]
    shares = [s for s in shares if np.isfinite(s)]
    return float(np.median(shares)) if shares and c.target.marker > 0.0 else None


def _shift(c: CameraCalibration, hypothesis: ErrorHypothesis) -> float:
    return float(np.sqrt(np.mean(c.work.shifts(hypothesis.intrinsics_change) ** 2)))


def _decides(c: CameraCalibration, hypothesis: ErrorHypothesis) -> bool:
    return hypothesis.sure and 1e3 * _shift(c, hypothesis) > BIASED * c.limits.work_mm


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
        case _:
            return (
                f"the focal length changes by {100 * amount:+.2f} +- {100 * sigma:.2f} % from the first view to the "
                "last: lock focus and zoom, and let the camera warm up"
            )


def _accuracy(c: CameraCalibration) -> list[str]:
    reasons = []
    worst = 1e3 * float(c.work_sigmas.max())
    helps = f"; take a view {c.next[0].words}" if c.next else ""
    if worst > c.limits.work_mm:
        reasons.append(
            f"points at {1e3 * c.work.near:.0f} to {1e3 * c.work.far:.0f} mm have a standard deviation of "
            f"{worst:.3g} mm, the limit is {c.limits.work_mm:g} mm" + helps
        )
    if c.corner_sigma > c.limits.corner_px:
        reasons.append(
            f"the corner error is {c.corner_sigma:.2f} px, the limit is {c.limits.corner_px:g} px: is the target the "
            "one in the target file, and are the images sharp and the target flat?"
        )
    if c.cross.sigma_px > HELD_OUT * c.corner_sigma:
        reasons.append(
            f"the corner error of held-out views is {c.cross.sigma_px:.3f} px, that of the used ones "
            f"{c.corner_sigma:.3f} px: the views do not determine the intrinsics" + helps
        )
    return reasons


def _photographs(c: CameraCalibration) -> list[str]:
    remarks = []
    covered = coverage(c)
    if covered < COVERED:
        remarks.append(
            f"corners lie in {100 * covered:.0f} % of the image; the rest is extrapolated: show the target near the "
            "edges too"
        )
    overexposed = [
        v.photo.name for v in c.used if v.photo.quality is not None and v.photo.quality.saturated > GLARING
    ]
    if overexposed:
        remarks.append(f"white is overexposed in {', '.join(overexposed)}: shorten the exposure")
    times = [v.photo.taken_s for v in c.used if v.photo.taken_s is not None]
    if len(times) == len(c.used) and max(times) - min(times) > LONG_S:
        remarks.append(
            f"the views span {(max(times) - min(times)) / 3600.0:.1f} h: the camera must not have been touched in "
            "between"
        )
    return remarks


def _distances(c: CameraCalibration) -> list[str]:
    distances = [v.distance for v in c.used]
    near, far = min(distances), max(distances)
    remarks = []
    if far < (1.0 + SPREAD) * near:
        remarks.append(
            f"all views are {1e3 * near:.0f} to {1e3 * far:.0f} mm away: show the target at more distances"
        )
    if c.work.near < (1.0 - SPREAD) * near or c.work.far > (1.0 + SPREAD) * far:
        remarks.append(
            f"the working distance is {1e3 * c.work.near:.0f} to {1e3 * c.work.far:.0f} mm, the views are "
            f"{1e3 * near:.0f} to {1e3 * far:.0f} mm away: show the target at the working distance"
        )
    return remarks


def _lens(c: CameraCalibration) -> list[str]:
    if any(_decides(c, s) for s in c.hypotheses):
        return []  # then all intrinsics are doubtful, and the reason explains it
    remarks = [
        f"{describe(s)} (it moves the work points by {1e3 * _shift(c, s):.3f} mm; their error includes this)"
        for s in c.hypotheses
        if s.sure
    ]
    for name, view in c.undetermined.items():
        place = NAMES.index(name)
        helps = f"; the most informative view is {view.words}" if view else ""
        remarks.append(
            f"{name} = {vector_of(c.camera)[place]:.3g} +- {c.sigmas[place]:.2g} is poorly determined by these views "
            f"(the error at the work points includes this){helps}"
        )
    jackknife, predicted = (float(np.sqrt(np.mean(s**2))) for s in (c.cross.work_sigmas, c.work_sigmas))
    if jackknife > SCATTERED * predicted:
        remarks.append(
            f"groups of views scatter by {1e3 * jackknife:.3f} mm at the work points, {1e3 * predicted:.3f} mm is "
            "expected: the corner errors are not independent"
        )
    return remarks
