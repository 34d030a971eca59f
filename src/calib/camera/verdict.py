"""Is a camera calibration good enough, and if not, why?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.camera.result import CameraCalibration
from calib.camera.score_tests import Suspect
from calib.model.intrinsics import NAMES, vector_of

BIASED = 1 / 3  # what part of the limit a suspect must move the work points to be a reason to refuse
HELD_OUT = 1.3  # largest error of held-out corners, times that of the used ones
LONG_S = 3600.0  # views over a longer time may not show one and the same camera
COVERED = 0.6  # part of the image
SPREAD = 0.1  # part of a distance that is no different distance
GLARING = 0.05  # part of the white that is at the sensor's end
SCATTERED = 2.5  # how much more than predicted the lenses of five groups may differ
CELLS = (8, 5)


@dataclass(frozen=True)
class Verdict:
    """Reasons to refuse, what else a person should know, and whether distances mean anything."""

    reasons: tuple[str, ...]
    remarks: tuple[str, ...]
    metric: bool = True


def judge(c: CameraCalibration) -> Verdict:
    """The verdict on a calibration, each reason with its figure, limit and what would help."""
    facing = _facing(c)
    if facing:
        return Verdict((*_number(c), facing, *_blind(c)), tuple(_photographs(c)), metric=False)
    reasons = [*_number(c), *_blind(c), *_target(c), *_accuracy(c)]
    return Verdict(tuple(reasons), (*_photographs(c), *_distances(c), *_lens(c)))


def coverage(c: CameraCalibration) -> float:
    """Part of the image's `CELLS` in which used views have corners, 0 to 1."""
    return float((cells(c) > 0).mean())


def cells(c: CameraCalibration) -> np.ndarray[tuple[int, int], np.dtype[np.intp]]:
    """How many corners of used views lie in each cell of the image, rows by columns."""
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


def _number(c: CameraCalibration) -> list[str]:
    if len(c.used) >= c.limits.views:
        return []
    left = [f"{v.photo.name}: {v.why_not}" for v in c.views if not v.used]
    return [
        f"{len(c.used)} views can be used, at least {c.limits.views} are needed"
        + (f" ({'; '.join(left)})" if left else "")
    ]


def _facing(c: CameraCalibration) -> str:
    tilts = np.array([v.tilt for v in c.used])
    tilted = int((tilts >= c.limits.tilt).sum())
    if tilted >= c.limits.tilted:
        return ""
    return (
        f"{tilted} of {len(tilts)} views are tilted by {np.degrees(c.limits.tilt):.0f} deg or more, at least "
        f"{c.limits.tilted} are needed (the most is {np.degrees(tilts.max()):.0f} deg): of a target that faces the "
        "camera, focal length and distance cannot be told apart; tilt it by 20 to 45 deg"
    )


def _blind(c: CameraCalibration) -> list[str]:
    """The polynomial turns back on itself where no corner was seen."""
    if not c.work.blind:
        return []
    return [
        f"the lens that fits has no inverse in {100 * c.work.blind:.0f} % of the image, towards its corners: its "
        f"distortion (k1 {c.camera.distortion[0]:.3g}, k2 {c.camera.distortion[1]:.3g}, k3 "
        f"{c.camera.distortion[4]:.3g}) is extrapolated from the {100 * coverage(c):.0f} % in which corners lie; show "
        "the target there too, or hold k2 and k3"
    ]


def _target(c: CameraCalibration) -> list[str]:
    reasons = []
    share = marker_share(c)
    if share is not None:
        off = share * c.target.square / c.target.marker - 1.0
        if abs(off) > c.limits.marker_share:
            reasons.append(
                f"its markers measure {1e3 * share * c.target.square:.2f} mm if its squares are "
                f"{1e3 * c.target.square:g} mm, but the target file says {1e3 * c.target.marker:g} mm: measure both "
                "on the print and correct the file (the size of the squares decides all distances)"
            )
    deciding = [s for s in c.suspects if _decides(c, s)]
    for suspect in deciding[:1]:  # the strongest may look like the others too
        reasons.append(f"{describe(suspect)}; it moves the work points by {1e3 * _moved(c, suspect):.2f} mm")
    return reasons


def marker_share(c: CameraCalibration) -> float | None:
    """Edge of the markers in squares, median over the used views; None without markers."""
    shares = [v.photo.quality.marker_share for v in c.used if v.photo.quality is not None]
    shares = [s for s in shares if np.isfinite(s)]
    return float(np.median(shares)) if shares and c.target.marker > 0.0 else None


def _moved(c: CameraCalibration, suspect: Suspect) -> float:
    return float(np.sqrt(np.mean(c.work.shifts(suspect.lens_change) ** 2)))


def _decides(c: CameraCalibration, suspect: Suspect) -> bool:
    return suspect.sure and 1e3 * _moved(c, suspect) > BIASED * c.limits.work_mm


def describe(suspect: Suspect) -> str:
    """A suspect in words, with its figure."""
    match suspect.name:
        case "bent target":
            return (
                f"the target is bent by {1e3 * abs(suspect.amount):.2f} +- {1e3 * suspect.sigma:.2f} mm: glue it to "
                "something flat and stiff"
            )
        case "stretched target":
            return (
                f"the target's rows are {100 * suspect.amount:+.2f} +- {100 * suspect.sigma:.2f} % further apart than "
                "its columns: print it without scaling and measure both"
            )
        case _:
            return (
                f"the focal length changes by {100 * suspect.amount:+.2f} +- {100 * suspect.sigma:.2f} % from the "
                "first view to the last: fix focus and zoom, and let the camera get warm"
            )


def _accuracy(c: CameraCalibration) -> list[str]:
    reasons = []
    worst = 1e3 * float(c.work_sigmas.max())
    helps = f"; take a view {c.next[0].words}" if c.next else ""
    if worst > c.limits.work_mm:
        reasons.append(
            f"points at {1e3 * c.work.near:.0f} to {1e3 * c.work.far:.0f} mm are known to {worst:.3g} mm (one standard "
            f"deviation), the limit is {c.limits.work_mm:g} mm" + helps
        )
    if c.corner_sigma > c.limits.corner_px:
        reasons.append(
            f"corners are off by {c.corner_sigma:.2f} px, the limit is {c.limits.corner_px:g} px: is the target the "
            "one of the target file, sharp, and flat?"
        )
    if c.cross.sigma_px > HELD_OUT * c.corner_sigma:
        reasons.append(
            f"corners of views that were held out are off by {c.cross.sigma_px:.3f} px, those that were used by "
            f"{c.corner_sigma:.3f} px: the views do not determine the lens between them" + helps
        )
    return reasons


def _photographs(c: CameraCalibration) -> list[str]:
    remarks = []
    covered = coverage(c)
    if covered < COVERED:
        remarks.append(
            f"corners lie in {100 * covered:.0f} % of the image; what lies elsewhere is extrapolated: show the target "
            "near the edges too"
        )
    lights = [
        v.photo.name for v in c.used if v.photo.quality is not None and v.photo.quality.saturated > GLARING
    ]
    if lights:
        remarks.append(f"white is overexposed in {', '.join(lights)}: shorten the exposure")
    times = [v.photo.taken_s for v in c.used if v.photo.taken_s is not None]
    if len(times) == len(c.used) and max(times) - min(times) > LONG_S:
        remarks.append(
            f"the views were taken over {(max(times) - min(times)) / 3600.0:.1f} h: the camera must not have been "
            "touched in between"
        )
    return remarks


def _distances(c: CameraCalibration) -> list[str]:
    distances = [v.distance for v in c.used]
    near, far = min(distances), max(distances)
    remarks = []
    if far < (1.0 + SPREAD) * near:
        remarks.append(
            f"all views are {1e3 * near:.0f} to {1e3 * far:.0f} mm away: show the target nearer and farther too"
        )
    if c.work.near < (1.0 - SPREAD) * near or c.work.far > (1.0 + SPREAD) * far:
        remarks.append(
            f"the work is {1e3 * c.work.near:.0f} to {1e3 * c.work.far:.0f} mm away, the views {1e3 * near:.0f} to "
            f"{1e3 * far:.0f} mm: show the target where the work is"
        )
    return remarks


def _lens(c: CameraCalibration) -> list[str]:
    if any(_decides(c, s) for s in c.suspects):
        return []  # then all numbers are doubtful, and the reason says why
    remarks = [
        f"{describe(s)} (it moves the work points by {1e3 * _moved(c, s):.3f} mm; their error has that in it)"
        for s in c.suspects
        if s.sure
    ]
    for name, view in c.undetermined.items():
        place = NAMES.index(name)
        helps = f"; a view {view.words} would tell most of it" if view else ""
        remarks.append(
            f"{name} = {vector_of(c.camera)[place]:.3g} +- {c.sigmas[place]:.2g} is hardly determined by these views "
            f"(the error at the work points has that in it){helps}"
        )
    jackknife, predicted = (float(np.sqrt(np.mean(s**2))) for s in (c.cross.work_sigmas, c.work_sigmas))
    if jackknife > SCATTERED * predicted:
        remarks.append(
            f"groups of views differ by {1e3 * jackknife:.3f} mm at the work points where {1e3 * predicted:.3f} mm is "
            "expected: the errors of corners are not independent"
        )
    return remarks
