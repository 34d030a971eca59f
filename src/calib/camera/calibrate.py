"""Calibrate a camera from images of a target: intrinsics, their uncertainty, and a verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array, Bools, frozen
from calib.camera.bundle_adjustment import (
    Bundle,
    View,
    adjust,
    information,
    intrinsics_covariance,
    residual_of,
)
from calib.camera.cross_validation import cross_validate
from calib.camera.flat_views import NOMINAL, FlatViews, Lift
from calib.camera.initial_guess import initial_guess, pose_of
from calib.camera.next_views import NextView, next_views
from calib.camera.result import CalibrationLimits, CalibrationView, CameraCalibration
from calib.camera.score_tests import error_hypotheses
from calib.camera.verdict import with_verdict
from calib.camera.view_selection import TargetPhoto, left_out, outlying_corner, outlying_views, unusable
from calib.camera.working_volume import working_volume
from calib.model.intrinsics import NAMES, pinhole, vector_of
from calib.model.optimal_design import OptimalDesign
from vision.camera.model import Camera, Region
from vision.camera.projection import Projection
from vision.targets.target import FEWEST_CORNERS, Target

FEWEST_VIEWS = 3  # needed to compute anything
WEAK, FELT = 3e-3, 2.0  # see `_undetermined`
MOST_KEPT = 0.75  # of a view's corners; with fewer left, none is dropped, as the whole view is wrong
_ROUNDS = 12  # of outlier rejection


def calibrate_camera(
    photos: Sequence[TargetPhoto],
    target: Target,
    size: tuple[int, int],
    *,
    held: Sequence[str] = (),
    work: tuple[float, float] | None = None,
    limits: CalibrationLimits | None = None,
    lifts: Mapping[str, Lift] | None = None,
    flat: bool = True,
    region: Region | None = None,
) -> CameraCalibration:
    """Fit the intrinsics to images of a target, and judge the fit.

    Args:
        photos: in the order in which they were taken.
        target: shown in the images.
        size: width and height of the images, px.
        held: distortion coefficients to hold at zero, of k1 k2 p1 p2 k3.
        work: nearest and farthest working distance from the camera, m; default: those of the views.
        limits: for acceptance.
        lifts: of the images with these names, in which the target lies on a box; it lies on one plane in all others.
        region: part of the image that matters: left, top, right, bottom, px; default: all of it.
        flat: whether to estimate an honest interval of the focal length where too few views are tilted (seconds).

    Raises:
        CalibrationRefused: fewer than `FEWEST_VIEWS` images are usable (the message gives the reason for each), or
            `lifts` are given and the target was not parallel to itself.
    """
    limits = limits or CalibrationLimits()
    free = np.array([name not in held for name in NAMES])
    reasons = unusable(photos)
    if (left := reasons.count("")) < FEWEST_VIEWS:
        why = left_out([photo.name for photo in photos], reasons)
        raise CalibrationRefused(
            f"{left} of {len(photos)} images are usable, at least {FEWEST_VIEWS} are needed"
            f"{f': {why}' if why else ''}",
            usable=left,
            photographs=len(photos),
        )
    found = _without_outliers(photos, target, size, free, reasons)
    corner_sigma = found.bundle.corner_sigma
    known_lifts = [(lifts or {}).get(photos[i].name) for i in found.index]
    lain = None
    tilted = sum(abs(T[2, 2]) <= np.cos(limits.tilt) for T in found.bundle.poses)
    if any(known_lifts) or (flat and tilted < limits.tilted):
        if any(known_lifts):
            _require_parallel(found, photos, limits.tilt)
        lain = FlatViews(found.views, target, size, known_lifts, corner_sigma).solve()
        residuals = tuple(
            residual_of(lain.camera, T, v) for T, v in zip(lain.poses, found.views, strict=True)
        )
        bundle = replace(found.bundle, camera=lain.camera, poses=lain.poses, residuals=residuals)
        found = replace(found, bundle=bundle)
    distances = work or _distances(found.bundle, found.views)
    volume = working_volume(found.bundle.camera, *distances, region)
    informations = information(found.bundle, found.views)
    prior = np.diag((found.bundle.corner_sigma / found.bundle.prior.sigma) ** 2)
    if lain is None and len(found.index) > limits.most_views:
        design = OptimalDesign(np.array(informations), prior, volume.worth)
        found = _best(found, sorted(design.best(limits.most_views, exchange=False).places), reasons)
        volume = working_volume(found.bundle.camera, *distances, region)
        informations = information(found.bundle, found.views)
    bundle = found.bundle
    if lain is None:
        corner_sigma = bundle.corner_sigma  # of the views that were chosen
        covariance = intrinsics_covariance(informations, free, corner_sigma, bundle.prior)
        hypotheses = tuple(error_hypotheses(bundle, found.views, target))
    else:  # the flat fit has these errors among its unknowns
        covariance, hypotheses = lain.covariance, ()
    known = prior + sum(informations)
    undetermined = _undetermined(bundle.camera, covariance, free, corner_sigma)
    # each established error moves the lens as if it had been an unknown of the fit
    for change in (s.intrinsics_change for s in hypotheses if s.sure):
        covariance = covariance + np.outer(change, change)
    calibration = CameraCalibration(
        bundle.camera,
        frozen(covariance),
        free,
        corner_sigma,
        _calibration_views(photos, reasons, found, target),
        target,
        volume,
        frozen(volume.sigmas(covariance)),
        cross_validate(bundle, found.views, volume),
        hypotheses,
        {name: _most_informative(name, bundle.camera, target, known, distances) for name in undetermined},
        tuple(next_views(bundle.camera, target, known, volume.worth, *distances)),
        limits,
        None if lain is None else lain.interval,
        lain is not None and any(known_lifts),
    )
    return with_verdict(calibration)


def _require_parallel(found: _Found, photos: Sequence[TargetPhoto], tilt: float) -> None:
    # foreshortening hardly depends on the focal length, which least squares may get very wrong here
    size = found.bundle.camera.size
    camera = pinhole(NOMINAL * size[0], size)
    poses = [pose_of(view, camera) for view in found.views]
    middle = np.median([T[:3, 2] for T in poses], axis=0)
    middle /= np.linalg.norm(middle)
    for i, T in zip(found.index, poses, strict=True):
        off = float(np.arccos(np.clip(middle @ T[:3, 2], -1.0, 1.0)))
        if off > tilt:
            raise CalibrationRefused(
                f"{photos[i].name}: the target is tilted by {np.degrees(off):.0f} deg against the other views, but "
                "with --lift it must lie on the plane in all of them, or on a box; leave out --lift or this image",
                photograph=photos[i].name,
                tilt_deg=float(np.degrees(off)),
            )


@dataclass(frozen=True, eq=False)
class _Found:
    """An adjustment of the images with these indices, and the corners kept in each."""

    bundle: Bundle
    views: list[View]
    index: list[int]
    kept: dict[int, Bools]


def _without_outliers(
    photos: Sequence[TargetPhoto], target: Target, size: tuple[int, int], free: Bools, reasons: list[str]
) -> _Found:
    """Adjust, reject outlying views and corners, and repeat until there are none."""
    shown = {i: p.view for i, p in enumerate(photos) if p.view is not None and not reasons[i]}
    kept = {i: np.ones(len(view.ids), dtype=bool) for i, view in shown.items()}

    def view_of(i: int) -> View:
        return View(target.points()[shown[i].ids[kept[i]]], shown[i].corners_px[kept[i]])

    index = list(shown)
    views = [view_of(i) for i in index]
    bundle = initial_guess(views, size)
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
            if outlying.sum() > len(index) // 3:  # too many to be outliers
                outlying[:] = False
            for place in map(int, np.flatnonzero(outlying)):
                reasons[index[place]] = (
                    f"does not fit the other views: {np.sqrt(variances[place]):.2f} px rms, theirs is "
                    f"{np.sqrt(np.median(variances)):.2f} px; it moved, or the target is partly hidden"
                )
                changed = True
        if not changed:
            break
        poses = [T for T, i in zip(bundle.poses, index, strict=True) if not reasons[i]]
        index = [i for i in index if not reasons[i]]
        views = [view_of(i) for i in index]
        bundle = adjust(views, bundle.camera, poses, free, bundle.prior)
    return _Found(bundle, views, index, kept)


def _best(found: _Found, chosen: Sequence[int], reasons: list[str]) -> _Found:
    for place, i in enumerate(found.index):
        if place not in chosen:
            reasons[i] = "adds little to the views used: held out for validation"
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


def _undetermined(camera: Camera, covariance: Array, free: Bools, corner_sigma: float) -> tuple[str, ...]:
    """Intrinsics that the views do not determine.

    A focal length or a coordinate of the principal point is undetermined if its standard deviation exceeds `WEAK` times
    the image width. A distortion coefficient is undetermined if it is within two standard deviations of zero, and one
    standard deviation moves the image's corner by more than `FELT` times the corner error. So a coefficient that is
    known to be small is determined.
    """
    sigma = np.sqrt(np.diag(covariance))
    middle = (np.array(camera.size) - 1.0) / 2.0
    ends = np.append((middle + 0.5) / np.diag(camera.K)[:2], 1.0)[None]
    felt = np.linalg.norm(camera.intrinsics_jacobian(ends)[0], axis=0) * sigma > FELT * corner_sigma
    weak = sigma > WEAK * camera.size[0]
    zero = np.abs(vector_of(camera)) < 2.0 * sigma
    undetermined = np.where(np.arange(len(NAMES)) < 4, weak, zero & felt) & free
    return tuple(name for name, bad in zip(NAMES, undetermined, strict=True) if bad)


def _most_informative(
    name: str, camera: Camera, target: Target, known: Array, distances: tuple[float, float]
) -> NextView | None:
    """Return the view that would add most information on one of the intrinsics."""
    worth = np.eye(len(NAMES))[:, [NAMES.index(name)]]
    found = next_views(camera, target, known, worth, *distances, count=1)
    return found[0] if found else None


def _calibration_views(
    photos: Sequence[TargetPhoto], reasons: Sequence[str], found: _Found, target: Target
) -> tuple[CalibrationView, ...]:
    poses = dict(zip(found.index, found.bundle.poses, strict=True))
    results = []
    for i, (photo, reason) in enumerate(zip(photos, reasons, strict=True)):
        T = poses.get(i)
        if T is None or photo.view is None:
            results.append(CalibrationView(photo, False, reason))
            continue
        seen = Projection(found.bundle.camera, T, target.points()[photo.view.ids])
        residual, distance = photo.view.corners_px - seen.pixels, float(seen.in_camera[:, 2].mean())
        results.append(CalibrationView(photo, True, "", T, frozen(residual), ~found.kept[i], distance))
    return tuple(results)
