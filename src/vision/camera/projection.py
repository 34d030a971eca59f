"""Points of targets projected into images, with all derivatives of the pixels: one Jacobian for every calibration."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm.se3 import Array, by_twist
from vision.camera.model import Camera


@dataclass(frozen=True, eq=False)
class Projection:
    """Projected points of a target at one or many poses; derivatives are computed on first use.

    Attributes:
        camera: intrinsics; at the origin.
        T: T_camera_target, (..., 4, 4).
        points: (m, 3) m in the target frame.
    """

    camera: Camera
    T: Array
    points: Array

    @cached_property
    def in_camera(self) -> Array:
        """Points in the camera frame, (..., m, 3) m."""
        return np.asarray(self.points @ np.swapaxes(self._R, -1, -2) + self.T[..., None, :3, 3])

    @cached_property
    def pixels(self) -> Array:
        """(..., m, 2) px; NaN for points behind the camera."""
        return self.camera.project(self.in_camera)

    @cached_property
    def by_camera_point(self) -> Array:
        """Derivative by the points in the camera frame, (..., m, 2, 3) px/m."""
        return self.camera.projection_jacobian(self.in_camera)

    @cached_property
    def by_point(self) -> Array:
        """Derivative by the points in the target frame, (..., m, 2, 3) px/m."""
        return np.asarray(self.by_camera_point @ self._R[..., None, :, :])

    @cached_property
    def by_target(self) -> Array:
        """Derivative by the twist of the target in its own frame, (..., m, 2, 6) px per m and rad."""
        return by_twist(self.by_point, self.points)

    @cached_property
    def by_camera(self) -> Array:
        """Derivative by a twist of the target in the camera frame, (..., m, 2, 6) px per m and rad."""
        return by_twist(self.by_camera_point, self.in_camera)

    @cached_property
    def by_intrinsics(self) -> Array:
        """Derivative by the nine intrinsics, (..., m, 2, 9)."""
        return self.camera.intrinsics_jacobian(self.in_camera)

    @property
    def _R(self) -> Array:
        return self.T[..., :3, :3]


def along(by_target: Array, twists: Array) -> Array:
    """Derivatives (n, m, 2, k) by unknowns that move the target by twists (n, k, 6), from `Projection.by_target`."""
    n, m = by_target.shape[:2]
    return np.asarray((by_target.reshape(n, -1, 6) @ np.swapaxes(twists, 1, 2)).reshape(n, m, 2, -1))
