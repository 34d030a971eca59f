"""Bundle adjustment of the intrinsics and the target pose of every view, by Levenberg-Marquardt.

It minimises the reprojection errors of the corners.

Views are coupled only through the intrinsics, so the pose of each view is eliminated (Schur complement; B. Triggs et
al., "Bundle adjustment: a modern synthesis", 2000, section 6.1). The reduced 9 x 9 information matrices add up over
views: selecting views, holding some out and proposing the next one all work on sums of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.errors import CalibrationRefused
from arm.se3 import Array, rotation, transform
from calib.model.intrinsics import COUNT, camera_of, lens_parameter_jacobian, vector_of
from vision.boards.pose_fit import pose_jacobian
from vision.camera.model import Camera

Bools = npt.NDArray[np.bool_]

_STEPS = 100
COST_DONE = 1e-10  # relative change of the cost
_MOST_DAMPING = 1e8
PRIOR_CORNER_PX = 0.02  # corner error the prior is weighted against; the true one is known only after the fit


@dataclass(frozen=True, eq=False)
class Prior:
    """Prior on the intrinsics: keeps parameters bounded that no view determines.

    Attributes:
        mean: (9,).
        sigma: (9,), wide enough not to affect parameters that the views determine.
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


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations of one view: intrinsics (9, 9), pose (6, 6), coupling (9, 6), gradients (9,) and (6,)."""

    lens: Array
    pose: Array
    both: Array
    lens_gradient: Array
    pose_gradient: Array

    def reduced(self, damping: float = 0.0) -> Array:
        """Information on the intrinsics with the pose eliminated, (9, 9)."""
        pose = self.pose + damping * np.diag(np.diag(self.pose))
        reduced: Array = self.lens - self.both @ np.linalg.solve(pose, self.both.T)
        return reduced


def blocks_of(camera: Camera, T_camera_target: Array, points: Array, residual: Array | None = None) -> Blocks:
    """Return the normal equations of a view whose coordinates are measured to 1 px.

    Args:
        camera: intrinsics.
        T_camera_target: pose, 4x4.
        points: of the target, (n, 3) m.
        residual: (n, 2) px; default: zero.
    """
    by_lens = lens_parameter_jacobian(camera, points @ T_camera_target[:3, :3].T + T_camera_target[:3, 3])
    J, P = by_lens.reshape(-1, COUNT), pose_jacobian(T_camera_target, points, camera).reshape(-1, 6)
    r = np.zeros(len(J)) if residual is None else residual.reshape(-1)
    return Blocks(J.T @ J, P.T @ P, J.T @ P, J.T @ r, P.T @ r)


def residual_of(camera: Camera, T_camera_target: Array, view: View) -> Array:
    """Measured minus projected corners, (n, 2) px; NaN for points behind the camera."""
    R, t = T_camera_target[:3, :3], T_camera_target[:3, 3]
    return np.asarray(view.pixels - camera.project(view.points @ R.T + t))


def adjust(
    views: Sequence[View],
    camera: Camera,
    poses: Sequence[Array],
    free: Bools,
    prior: Prior | None = None,
    done: float = COST_DONE,
) -> Bundle:
    """Minimise the squared residuals over intrinsics and poses, from a start.

    Args:
        views: of the target.
        camera, poses: the start; intrinsics that are not free keep the values of `camera`.
        free: (9,) of bool, see `calib.model.intrinsics.NAMES`.
        prior: on the intrinsics; default: about `camera`.
        done: relative change of the cost at which to stop.

    Raises:
        CalibrationRefused: the start puts a corner behind the camera.
    """
    now = _evaluated(views, camera, poses, free, prior or Prior.of(camera))
    if not np.isfinite(now.cost):
        raise CalibrationRefused("no camera fits the views: some corners would lie behind it", reason="start")
    damping = 1e-4
    for _ in range(_STEPS):
        blocks = [
            blocks_of(now.camera, T, v.points, r)
            for T, v, r in zip(now.poses, views, now.residuals, strict=True)
        ]
        then = _stepped(views, now, blocks, damping)
        gain = now.cost - then.cost
        if gain > 0.0:  # NaN compares false
            last = gain < done * now.cost
            now, damping = then, max(damping * 0.1, 1e-12)
            if last:
                break
        else:
            damping *= 10.0
            if damping > _MOST_DAMPING:
                break
    return now


def _evaluated(
    views: Sequence[View], camera: Camera, poses: Sequence[Array], free: Bools, prior: Prior
) -> Bundle:
    residuals = tuple(residual_of(camera, T, v) for T, v in zip(poses, views, strict=True))
    return Bundle(camera, tuple(poses), residuals, free, prior)


def _stepped(views: Sequence[View], now: Bundle, blocks: Sequence[Blocks], damping: float) -> Bundle:
    weight = now.prior.weight
    S, g = np.diag(weight), weight * (now.prior.mean - vector_of(now.camera))
    solved: list[tuple[npt.NDArray[Any], npt.NDArray[Any]]] = []
    for b in blocks:
        damped = b.pose + damping * np.diag(np.diag(b.pose))
        by_lens, alone = np.linalg.solve(damped, b.both.T), np.linalg.solve(damped, b.pose_gradient)
        solved.append((np.asarray(by_lens), np.asarray(alone)))
        S += b.lens - b.both @ by_lens
        g += b.lens_gradient - b.both @ alone
    S += damping * np.diag(np.diag(sum((b.lens for b in blocks), np.zeros((COUNT, COUNT)))))
    lens_step = np.zeros(COUNT)
    lens_step[now.free] = solve_scaled(S[np.ix_(now.free, now.free)], g[now.free])
    poses = []
    for T, (by_lens, alone) in zip(now.poses, solved, strict=True):
        xi = alone - by_lens @ lens_step
        poses.append(T @ transform(rotation(xi[3:]), xi[:3]))
    camera = camera_of(vector_of(now.camera) + lens_step, now.camera.size)
    with np.errstate(all="ignore"):  # the caller rejects a step that is too long
        return _evaluated(views, camera, poses, now.free, now.prior)


def solve_scaled(S: Array, g: Array) -> Array:
    """Return S^-1 g for a positive matrix whose rows differ by many orders of magnitude, as those of fx and k3 do.

    Raises:
        numpy.linalg.LinAlgError: some elements are not finite.
    """
    scale, scaled = _scaled(S)
    solution, *_ = np.linalg.lstsq(scaled, _finite(scale * g), rcond=1e-14)
    return np.asarray(scale * solution)


def inverse_scaled(S: Array) -> Array:
    """Return S^-1 for such a matrix; undetermined parameters get a very large variance.

    Raises:
        numpy.linalg.LinAlgError: some elements are not finite.
    """
    scale, scaled = _scaled(S)
    values, vectors = np.linalg.eigh(scaled)
    inverse = vectors @ np.diag(1.0 / np.maximum(values, 1e-15)) @ vectors.T
    return np.asarray(inverse * np.outer(scale, scale))


def _scaled(S: Array) -> tuple[Array, Array]:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    return scale, _finite(S * np.outer(scale, scale))


def _finite(numbers: Array) -> Array:
    if not np.isfinite(numbers).all():  # LAPACK would print to the terminal
        raise np.linalg.LinAlgError("some elements are not finite")
    return numbers


def information(bundle: Bundle, views: Sequence[View]) -> list[Array]:
    """Information of each view on the intrinsics, (9, 9) each, for corner errors of 1 px."""
    return [blocks_of(bundle.camera, T, v.points).reduced() for T, v in zip(bundle.poses, views, strict=True)]


def intrinsics_covariance(informations: Sequence[Array], free: Bools, sigma_px: float, prior: Prior) -> Array:
    """Covariance (9, 9) of the intrinsics from the views' information; zero rows for those that are not free."""
    S = sum(informations, np.zeros((COUNT, COUNT))) / sigma_px**2 + np.diag(prior.sigma**-2)
    covariance = np.zeros((COUNT, COUNT))
    covariance[np.ix_(free, free)] = inverse_scaled(S[np.ix_(free, free)])
    return covariance
