"""Bundle adjustment of the intrinsics and the target pose of every view, by Levenberg-Marquardt.

Views are coupled only through the intrinsics, so the pose of each view is eliminated (Schur complement; B. Triggs et
al., "Bundle adjustment: a modern synthesis", 2000, section 6.1). The information of several views is the sum of their
reduced 9 x 9 matrices. Selecting views, holding some out and proposing the next one all work on such sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array, Bools, moved
from calib.model.intrinsics import COUNT, camera_of, vector_of
from calib.model.least_squares import (
    Eliminated,
    Step,
    eliminate,
    embedded,
    inverse_scaled,
    levenberg_marquardt,
    solve_scaled,
)
from vision.camera.model import Camera
from vision.camera.projection import Projection

_STEPS = 100
COST_DONE = 1e-10  # relative change of the cost
PRIOR_CORNER_PX = 0.02  # corner error assumed to weight the prior; the actual one is not known before


@dataclass(frozen=True, eq=False)
class Prior:
    """Prior on the intrinsics: it bounds parameters that no view determines.

    Attributes:
        mean: (9,).
        sigma: standard deviations (9,), wide enough not to affect parameters that the views determine.
    """

    mean: Array
    sigma: Array

    @classmethod
    def of(cls, camera: Camera) -> Prior:
        """Return a prior about a first guess: each sigma moves points at the image corner by some 30 %."""
        f, size = np.diag(camera.K)[:2], np.array(camera.size)
        r = float(np.linalg.norm(size / 2.0 / f))
        mean = np.array([*f, *((size - 1.0) / 2.0), 0.0, 0.0, 0.0, 0.0, 0.0])
        return cls(mean, 0.3 * np.array([*f, *size, r**-2, r**-4, 1.0 / r, 1.0 / r, r**-6]))

    @property
    def weight(self) -> Array:
        """Weights (9,) in px^2, relative to corners of weight 1."""
        return np.asarray((PRIOR_CORNER_PX / self.sigma) ** 2)


@dataclass(frozen=True, eq=False)
class View:
    """Corners of the target in one image.

    Attributes:
        points: (n, 3) m in the target frame.
        pixels: (n, 2) px.
    """

    points: Array
    pixels: Array


@dataclass(frozen=True, eq=False)
class Bundle:
    """Intrinsics and target poses fitted to views.

    Attributes:
        camera: at the origin.
        poses: T_camera_target of every view, 4x4.
        residuals: of every view, (n, 2) px, measured minus projected.
        free: (9,) intrinsics that were fitted.
        prior: on the intrinsics.
    """

    camera: Camera
    poses: tuple[Array, ...]
    residuals: tuple[Array, ...]
    free: Bools
    prior: Prior

    @property
    def squares(self) -> float:
        """Sum of squared residuals, px^2."""
        return float(sum((r**2).sum() for r in self.residuals))

    @property
    def cost(self) -> float:
        """Cost that the adjustment minimises, px^2."""
        off = vector_of(self.camera) - self.prior.mean
        return self.squares + float((self.prior.weight * off**2)[self.free].sum())

    @property
    def degrees_of_freedom(self) -> int:
        """Number of measured coordinates minus number of fitted parameters."""
        return sum(r.size for r in self.residuals) - 6 * len(self.poses) - int(self.free.sum())

    @property
    def corner_sigma(self) -> float:
        """Unbiased standard deviation of a corner coordinate, px (unlike the rms of the residuals)."""
        return float(np.sqrt(self.squares / max(self.degrees_of_freedom, 1)))


def view_equations(
    camera: Camera, T_camera_target: Array, points: Array, residual: Array | None = None, damping: float = 0.0
) -> Eliminated:
    """Return the normal equations of the nine intrinsics from a view, its pose eliminated, for corner errors of 1 px.

    Args:
        camera: intrinsics.
        T_camera_target: pose, 4x4.
        points: of the target, (n, 3) m.
        residual: (n, 2) px; default: zero.
        damping: of the pose, see `calib.model.least_squares.eliminate`.
    """
    p = Projection(camera, T_camera_target, points)
    r = np.zeros(2 * len(points)) if residual is None else residual.reshape(-1)
    return eliminate(p.by_intrinsics.reshape(-1, COUNT), p.by_target.reshape(-1, 6), r, damping=damping)


def residual_of(camera: Camera, T_camera_target: Array, view: View) -> Array:
    """Reprojection error of a view: measured minus projected corners, (n, 2) px; NaN for points behind the camera."""
    return np.asarray(view.pixels - Projection(camera, T_camera_target, view.points).pixels)


def adjust(
    views: Sequence[View],
    camera: Camera,
    poses: Sequence[Array],
    free: Bools,
    prior: Prior | None = None,
    done: float = COST_DONE,
) -> Bundle:
    """Minimise the reprojection error over intrinsics and poses.

    Args:
        views: of the target.
        camera, poses: where to start; intrinsics that are not free keep the values of `camera`.
        free: (9,) of bool, see `calib.model.intrinsics.NAMES`.
        prior: on the intrinsics; default: about `camera`.
        done: relative change of the cost at which to stop.

    Raises:
        CalibrationRefused: the start puts a corner behind the camera.
    """
    now = _evaluated(views, camera, poses, free, prior or Prior.of(camera))
    if not np.isfinite(now.cost):
        raise CalibrationRefused("no camera fits the views: some corners would lie behind it", reason="start")

    def linearise(bundle: Bundle) -> Step[Bundle]:
        def step(damping: float) -> tuple[Bundle, bool]:
            then = _stepped(views, bundle, damping)
            return then, bundle.cost - then.cost < done * bundle.cost

        return step

    return levenberg_marquardt(now, lambda bundle: bundle.cost, linearise, _STEPS, damping=1e-4)[0]


def _evaluated(
    views: Sequence[View], camera: Camera, poses: Sequence[Array], free: Bools, prior: Prior
) -> Bundle:
    residuals = tuple(residual_of(camera, T, v) for T, v in zip(poses, views, strict=True))
    return Bundle(camera, tuple(poses), residuals, free, prior)


def _stepped(views: Sequence[View], now: Bundle, damping: float) -> Bundle:
    weight, free = now.prior.weight, now.free
    S, g = np.diag(weight), weight * (now.prior.mean - vector_of(now.camera))
    equations = [
        view_equations(now.camera, T, v.points, r, damping)
        for T, v, r in zip(now.poses, views, now.residuals, strict=True)
    ]
    S = S + sum(e.S for e in equations)
    g = g + sum(e.g for e in equations)
    S += damping * np.diag(np.diag(S))
    step = np.zeros(COUNT)
    step[free] = solve_scaled(S[np.ix_(free, free)], g[free])
    poses = [moved(T, e.alone - e.by_kept @ step) for T, e in zip(now.poses, equations, strict=True)]
    camera = camera_of(vector_of(now.camera) + step, now.camera.size)
    with np.errstate(all="ignore"):  # a step that is too long is rejected
        return _evaluated(views, camera, poses, free, now.prior)


def information(bundle: Bundle, views: Sequence[View]) -> list[Array]:
    """Information of each view on the intrinsics, (9, 9) each, for corner errors of 1 px."""
    return [view_equations(bundle.camera, T, v.points).S for T, v in zip(bundle.poses, views, strict=True)]


def intrinsics_covariance(informations: Sequence[Array], free: Bools, sigma_px: float, prior: Prior) -> Array:
    """Covariance (9, 9) of the intrinsics from the views' information; zero rows for those that are not free."""
    S = sum(informations, np.zeros((COUNT, COUNT))) / sigma_px**2 + np.diag(prior.sigma**-2)
    return embedded(inverse_scaled(S[np.ix_(free, free)]), free)
