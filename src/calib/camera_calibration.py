"""From photographs of a target to a lens with its uncertainty and a verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from arm.errors import CalibrationRefused
from arm.se3 import Array, frozen
from calib.bundle import Bundle, View, adjust, information, lens_covariance
from calib.camera_start import start
from calib.camera_verdict import judge
from calib.cross_check import CrossCheck, cross_check
from calib.intrinsics import NAMES, lens_parameter_jacobian, vector_of
from calib.next_views import NextView, information_of, next_views
from calib.suspects import Suspect, suspects
from calib.view_choice import (
    TargetPhoto,
    best_views,
    outlying_corner,
    outlying_views,
    unusable,
)
from calib.work_points import WorkPoints, work_points
from vision.camera import Camera
from vision.target import FEWEST_CORNERS, Target

FEWEST_VIEWS = 3  # with fewer nothing can be computed at all
WEAK, FELT = 3e-3, 2.0  # see `_undetermined`
MOST_KEPT = 0.75  # part of a view's corners of which no further one is left out: then the view is wrong
_ROUNDS = 12  # of naming outliers


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
        covariance: (9, 9), order of `calib.intrinsics.NAMES`; zero rows for numbers that were held.
        free: (9,) which were fitted.
        corner_sigma: error of a corner's coordinate, px, without bias.
        views: every photograph in the order given.
        target: that was shown.
        work: the points where errors count.
        work_sigmas: (n,) m standard deviation across the line of sight at each.
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
    calibration = CameraCalibration(
        bundle.camera,
        frozen(covariance),
        free,
        bundle.corner_sigma,
        _told(photos, reasons, found, target),
        target,
        place,
        frozen(place.sigmas(covariance)),
        cross_check(bundle, found.views, place),
        tuple(suspects(bundle, found.views, target)),
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
