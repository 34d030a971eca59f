"""From photographs of a target to a lens with its uncertainty and a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from arm.errors import CalibrationRefused
from arm.se3 import Array, frozen
from calib.camera.bundle_adjustment import Bundle, View, adjust, information, lens_covariance
from calib.camera.cross_validation import cross_check
from calib.camera.initial_guess import start
from calib.camera.next_views import NextView, information_of, next_views
from calib.camera.result import CalibrationLimits, CalibrationView, CameraCalibration
from calib.camera.score_tests import suspects
from calib.camera.verdict import judge
from calib.camera.view_selection import (
    TargetPhoto,
    best_views,
    outlying_corner,
    outlying_views,
    unusable,
)
from calib.camera.working_volume import work_points
from calib.model.intrinsics import NAMES, lens_parameter_jacobian, vector_of
from vision.camera.model import Camera
from vision.targets.target import FEWEST_CORNERS, Target

FEWEST_VIEWS = 3  # with fewer nothing can be computed at all
WEAK, FELT = 3e-3, 2.0  # see `_undetermined`
MOST_KEPT = 0.75  # part of a view's corners of which no further one is left out: then the view is wrong
_ROUNDS = 12  # of naming outliers


def calibrate_camera(
    photos: Sequence[TargetPhoto],
    target: Target,
    size: tuple[int, int],
    *,
    held: Sequence[str] = (),
    work: tuple[float, float] | None = None,
    limits: CalibrationLimits | None = None,
) -> CameraCalibration:
    """Fit a lens to photographs of a target, and judge it.

    Args:
        photos: in the order in which they were taken.
        target: that they show.
        size: width and height of the images, px.
        held: numbers of the lens to leave at zero, of k1 k2 p1 p2 k3.
        work: nearest and farthest distance of the work from the camera, m; default: those of the views.
        limits: when it is refused.

    Raises:
        CalibrationRefused: too few photographs can be used to compute anything; the message says why each fell.
    """
    limits = limits or CalibrationLimits()
    free = np.array([name not in held for name in NAMES])
    reasons = unusable(photos)
    candidates = [i for i, reason in enumerate(reasons) if not reason]
    if len(candidates) < FEWEST_VIEWS:
        raise CalibrationRefused(_too_few(photos, reasons), usable=len(candidates), photographs=len(photos))
    found = _without_outliers(photos, candidates, target, size, free, reasons)
    points = work or _distances(found.bundle, found.views)
    place = work_points(found.bundle.camera, *points)
    informations = information(found.bundle, found.views)
    scale = found.bundle.corner_sigma
    prior = (scale / found.bundle.prior.sigma) ** 2
    if len(found.index) > limits.most_views:
        found = _best(found, best_views(informations, place.worth, prior, limits.most_views), reasons)
        place = work_points(found.bundle.camera, *points)
        informations = information(found.bundle, found.views)
    bundle = found.bundle
    covariance = lens_covariance(informations, free, bundle.corner_sigma, bundle.prior)
    known = information_of(informations, prior)
    lost = _undetermined(bundle.camera, covariance, free, bundle.corner_sigma)
    troubles = tuple(suspects(bundle, found.views, target))
    moved = sum((place.shifts(s.lens_change) ** 2 for s in troubles if s.sure), np.zeros(len(place.points)))
    calibration = CameraCalibration(
        bundle.camera,
        frozen(covariance),
        free,
        bundle.corner_sigma,
        _told(photos, reasons, found, target),
        target,
        place,
        frozen(np.sqrt(place.sigmas(covariance) ** 2 + moved)),
        cross_check(bundle, found.views, place),
        troubles,
        {name: _telling(name, bundle.camera, target, known, points) for name in lost},
        tuple(next_views(bundle.camera, target, known, place.worth, *points)),
        limits=limits,
    )
    verdict = judge(calibration)
    advised = calibration.next if verdict.metric else ()
    return replace(calibration, reasons=verdict.reasons, remarks=verdict.remarks, next=advised)


@dataclass(frozen=True, eq=False)
class _Found:
    """An adjustment of the photographs `index`, with the corners of each that count."""

    bundle: Bundle
    views: list[View]
    index: list[int]
    kept: dict[int, npt.NDArray[np.bool_]]


def _view(photo: TargetPhoto, target: Target, kept: npt.NDArray[np.bool_]) -> View:
    if photo.view is None:
        raise CalibrationRefused(f"{photo.name}: shows no target", photograph=photo.name)
    return View(target.points()[photo.view.ids[kept]], photo.view.corners_px[kept])


def _corners(photo: TargetPhoto) -> int:
    return 0 if photo.view is None else len(photo.view.ids)


def _without_outliers(
    photos: Sequence[TargetPhoto],
    candidates: Sequence[int],
    target: Target,
    size: tuple[int, int],
    free: npt.NDArray[np.bool_],
    reasons: list[str],
) -> _Found:
    """Adjust, name views and corners that fit worse than chance, and adjust again until none is left."""
    index = list(candidates)
    kept = {i: np.ones(_corners(photos[i]), dtype=bool) for i in index}
    views = [_view(photos[i], target, kept[i]) for i in index]
    bundle = start(views, size)
    bundle = adjust(views, bundle.camera, bundle.poses, free, bundle.prior)
    for _ in range(_ROUNDS):
        residuals = np.concatenate([r.ravel() for r in bundle.residuals])
        robust = 1.4826 * float(np.median(np.abs(residuals)))
        changed = False
        for place, i in enumerate(index):
            worst = outlying_corner(bundle.residuals[place], robust)
            few = kept[i].sum() <= max(FEWEST_CORNERS, MOST_KEPT * len(kept[i]))
            if worst is not None and not few:
                kept[i][np.flatnonzero(kept[i])[worst]] = False
                changed = True
        variances = np.array([float(np.mean(r**2)) for r in bundle.residuals])
        counts = np.array([r.size - 6 for r in bundle.residuals])
        if not changed:
            outlying = outlying_views(variances, counts)
            if outlying.sum() > len(index) // 3:  # these are no outliers
                outlying[:] = False
            for place in map(int, np.flatnonzero(outlying)):
                reasons[index[place]] = (
                    f"does not fit the others: {np.sqrt(variances[place]):.2f} px rms, they have "
                    f"{np.sqrt(np.median(variances)):.2f} px; it was moved, or the target is hidden in part"
                )
                changed = True
        if not changed:
            break
        poses = [T for T, i in zip(bundle.poses, index, strict=True) if not reasons[i]]
        index = [i for i in index if not reasons[i]]
        views = [_view(photos[i], target, kept[i]) for i in index]
        bundle = adjust(views, bundle.camera, poses, free, bundle.prior)
    return _Found(bundle, views, index, kept)


def _best(found: _Found, chosen: Sequence[int], reasons: list[str]) -> _Found:
    for place, i in enumerate(found.index):
        if place not in chosen:
            reasons[i] = "adds little to the views used: held out, to check them"
    views = [found.views[p] for p in chosen]
    poses = [found.bundle.poses[p] for p in chosen]
    bundle = adjust(views, found.bundle.camera, poses, found.bundle.free, found.bundle.prior)
    return _Found(bundle, views, [found.index[p] for p in chosen], found.kept)


def _distances(bundle: Bundle, views: Sequence[View]) -> tuple[float, float]:
    distances = [
        float((view.points @ T[2, :3]).mean() + T[2, 3]) for view, T in zip(views, bundle.poses, strict=True)
    ]
    near, far = min(distances), max(distances)
    return near, max(far, 1.05 * near)


def _undetermined(
    camera: Camera, covariance: Array, free: npt.NDArray[np.bool_], corner_sigma: float
) -> tuple[str, ...]:
    """Numbers that the views say too little of.

    A focal length or principal point is known to worse than `WEAK` of the image's width; a number of the distortion
    might as well be zero, although its standard deviation alone moves the image's corner by more than `FELT` times
    the error of a corner (a number that is small and known to be small is determined).
    """
    sigma = np.sqrt(np.diag(covariance))
    middle = (np.array(camera.size) - 1.0) / 2.0
    ends = np.append((middle + 0.5) / np.diag(camera.K)[:2], 1.0)[None]
    felt = np.linalg.norm(lens_parameter_jacobian(camera, ends)[0], axis=0) * sigma > FELT * corner_sigma
    weak = sigma > WEAK * camera.size[0]
    zero = np.abs(vector_of(camera)) < 2.0 * sigma
    lost = np.where(np.arange(len(NAMES)) < 4, weak, zero & felt) & free
    return tuple(name for name, bad in zip(NAMES, lost, strict=True) if bad)


def _telling(
    name: str, camera: Camera, target: Target, known: Array, distances: tuple[float, float]
) -> NextView | None:
    """The view that says most of one number of the lens."""
    worth = np.zeros((len(NAMES), len(NAMES)))
    worth[NAMES.index(name), NAMES.index(name)] = 1.0
    found = next_views(camera, target, known, worth, *distances, count=1)
    return found[0] if found else None


def _told(
    photos: Sequence[TargetPhoto], reasons: Sequence[str], found: _Found, target: Target
) -> tuple[CalibrationView, ...]:
    poses = dict(zip(found.index, found.bundle.poses, strict=True))
    told = []
    for i, (photo, reason) in enumerate(zip(photos, reasons, strict=True)):
        T = poses.get(i)
        if T is None or photo.view is None:
            told.append(CalibrationView(photo, False, reason))
            continue
        points = target.points()[photo.view.ids] @ T[:3, :3].T + T[:3, 3]
        residual = photo.view.corners_px - found.bundle.camera.project(points)
        told.append(
            CalibrationView(photo, True, "", T, frozen(residual), ~found.kept[i], float(points[:, 2].mean()))
        )
    return tuple(told)


def _too_few(photos: Sequence[TargetPhoto], reasons: Sequence[str]) -> str:
    usable = sum(not reason for reason in reasons)
    why = "; ".join(
        f"{photo.name}: {reason}" for photo, reason in zip(photos, reasons, strict=True) if reason
    )
    return (
        f"{usable} of {len(photos)} photographs can be used, at least {FEWEST_VIEWS} are needed"
        f"{f': {why}' if why else ''}"
    )
