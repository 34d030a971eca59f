"""What a lens that is not exactly known costs where the work is done, mm.

A camera whose lens is a little wrong is also placed a little wrong, and most of the first error goes into the second.
What counts is what is left after the camera's place was determined anew with that lens (mrcal's "implied
transformation"; here linear, over points that fill the image between two distances).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.errors import CalibrationRefused
from arm.se3 import Array, skew
from calib.model.intrinsics import lens_parameter_jacobian
from vision.camera.model import Camera

COLUMNS, ROWS, LAYERS = 9, 6, 3
FEWEST = 4  # places in the image from which a camera's place follows


@dataclass(frozen=True, eq=False)
class WorkPoints:
    """Points of the camera frame where errors count, and what errors of the lens do there.

    Attributes:
        near, far: distances from the camera, m.
        points: (n, 3) m, at most LAYERS * ROWS * COLUMNS.
        effect: (2 n, 9) m across the line of sight by each number of the lens, the camera's place determined anew.
        seen: (ROWS, COLUMNS) places of the image where the lens has an inverse; elsewhere there are no points.
    """

    near: float
    far: float
    points: Array
    effect: Array
    seen: npt.NDArray[np.bool_]

    @property
    def blind(self) -> float:
        """Part of the image in which the lens has no inverse."""
        return float(1.0 - self.seen.mean())

    def sigmas(self, covariance: Array) -> Array:
        """Standard deviation of each point across the line of sight, (n,) m, for a covariance (9, 9) of the lens."""
        variance = np.einsum("ij,jk,ik->i", self.effect, covariance, self.effect)
        return np.asarray(np.sqrt(np.maximum(variance.reshape(-1, 2).sum(axis=1), 0.0)))

    def shifts(self, lens_change: Array) -> Array:
        """How far each point moves, (n,) m, when the lens changes by (9,)."""
        return np.asarray(np.linalg.norm((self.effect @ lens_change).reshape(-1, 2), axis=1))

    @property
    def worth(self) -> Array:
        """(9, 9): the mean variance over the points is the trace of this times the covariance of the lens."""
        return np.asarray(self.effect.T @ self.effect / len(self.points))


def work_points(camera: Camera, near: float, far: float) -> WorkPoints:
    """Points all over the image at distances from `near` to `far` m along the optical axis.

    Distortion that is extrapolated from the image's middle may turn back on itself towards the corners, where a pixel
    then belongs to no ray; such places are left out.

    Raises:
        CalibrationRefused: the lens has no inverse nearly anywhere.
    """
    width, height = camera.size
    u, v = np.meshgrid(
        (np.arange(COLUMNS) + 0.5) * width / COLUMNS - 0.5, (np.arange(ROWS) + 0.5) * height / ROWS - 0.5
    )
    rays = camera.normalised(np.stack([u.ravel(), v.ravel()], axis=-1))
    finite = np.isfinite(rays).all(axis=-1)
    if finite.sum() < FEWEST:
        raise CalibrationRefused(
            f"the lens that fits has no inverse at {len(rays) - finite.sum()} of {len(rays)} places in the image: "
            "these views do not determine its distortion; show the target all over the image, or hold k2 and k3",
            places=len(rays),
            without_inverse=int(len(rays) - finite.sum()),
        )
    rays = rays[finite]
    flat = np.concatenate([rays, np.ones((len(rays), 1))], axis=-1)
    points = np.concatenate([z * flat for z in np.linspace(near, far, LAYERS)])
    to_metres = points[:, 2, None, None] / np.diag(camera.K)[:2, None]
    by_lens = (to_metres * lens_parameter_jacobian(camera, points)).reshape(-1, 9)
    by_point = to_metres * camera.projection_jacobian(points)
    turns = np.stack([-skew(p) for p in points])
    by_place = np.concatenate([by_point, by_point @ turns], axis=-1).reshape(-1, 6)
    absorbed, *_ = np.linalg.lstsq(by_place, by_lens, rcond=None)
    return WorkPoints(near, far, points, by_lens - by_place @ absorbed, finite.reshape(ROWS, COLUMNS))
