"""Effect of errors of the intrinsics at the points where the camera works.

A camera with slightly wrong intrinsics also gets slightly wrong extrinsics, which absorb most of the error. What counts
is the error that remains after the extrinsics are refitted (mrcal's "implied transformation"). Here the refit is
linearised, over points that fill the image between two distances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array, Bools, by_twist
from vision.camera.model import Camera, Region

COLUMNS, ROWS, LAYERS = 9, 6, 3
FEWEST = 4  # rays needed to determine the extrinsics


@dataclass(frozen=True, eq=False)
class WorkingVolume:
    """Points in the camera frame where errors count, and the effect of the intrinsics on them.

    Attributes:
        near, far: distances from the camera, m.
        points: (n, 3) m, at most LAYERS * ROWS * COLUMNS.
        effect: shift across the line of sight, m, per unit of each intrinsic, with refitted extrinsics, (2 n, 9).
        seen: where in the region the distortion has an inverse, (ROWS, COLUMNS); elsewhere there are no points.
        blind: fraction of the image in which the distortion has no inverse.
        region: part of the image that matters: left, top, right, bottom, px; None for all of it.
    """

    near: float
    far: float
    points: Array
    effect: Array
    seen: Bools
    blind: float
    region: Region | None = None

    def sigmas(self, covariance: Array) -> Array:
        """Standard deviation of each point across the line of sight, (n,) m, for a covariance (9, 9)."""
        variance = np.einsum("ij,jk,ik->i", self.effect, covariance, self.effect)
        return np.asarray(np.sqrt(np.maximum(variance.reshape(-1, 2).sum(axis=1), 0.0)))

    def shifts(self, intrinsics_change: Array) -> Array:
        """Shift of each point, (n,) m, for a change (9,) of the intrinsics."""
        return np.asarray(np.linalg.norm((self.effect @ intrinsics_change).reshape(-1, 2), axis=1))

    @property
    def worth(self) -> Array:
        """Weights W (9, 9) of the intrinsics: trace(W^T covariance W) is the mean variance over the points."""
        return np.asarray(np.linalg.qr(self.effect / np.sqrt(len(self.points)))[1].T)


def working_volume(camera: Camera, near: float, far: float, region: Region | None = None) -> WorkingVolume:
    """Fill the image, or a `region` of it, with points at depths from `near` to `far` m.

    Distortion extrapolated from the middle of the image may not be monotonic towards the corners. Pixels without a ray
    are left out.

    Raises:
        CalibrationRefused: the distortion has no inverse almost everywhere.
    """
    whole = (0.0, 0.0, float(camera.size[0]), float(camera.size[1]))
    blind = 1.0 - float(np.isfinite(_rays(camera, whole)).all(axis=-1).mean())
    rays = _rays(camera, region or whole)
    finite = np.isfinite(rays).all(axis=-1)
    if finite.sum() < FEWEST:
        raise CalibrationRefused(
            f"the fitted distortion has no inverse at {len(rays) - finite.sum()} of {len(rays)} places in the image: "
            "these views do not determine it; show the target all over the image, or hold k2 and k3",
            places=len(rays),
            without_inverse=int(len(rays) - finite.sum()),
        )
    points = np.concatenate([z * rays[finite] for z in np.linspace(near, far, LAYERS)])
    to_metres = points[:, 2, None, None] / np.diag(camera.K)[:2, None]
    by_intrinsics = (to_metres * camera.intrinsics_jacobian(points)).reshape(-1, 9)
    by_point = to_metres * camera.projection_jacobian(points)
    by_pose = by_twist(by_point, points).reshape(-1, 6)
    absorbed, *_ = np.linalg.lstsq(by_pose, by_intrinsics, rcond=None)
    effect = by_intrinsics - by_pose @ absorbed
    return WorkingVolume(near, far, points, effect, finite.reshape(ROWS, COLUMNS), blind, region)


def _rays(camera: Camera, region: Region) -> Array:
    """Rays (ROWS * COLUMNS, 3) of a grid that fills a region; NaN where there is no inverse."""
    left, top, right, bottom = region
    u, v = np.meshgrid(
        left + (np.arange(COLUMNS) + 0.5) * (right - left) / COLUMNS - 0.5,
        top + (np.arange(ROWS) + 0.5) * (bottom - top) / ROWS - 0.5,
    )
    return camera.rays(np.stack([u.ravel(), v.ravel()], axis=-1))
