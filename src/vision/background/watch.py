"""The watch on the camera: each look's images are compared with the background, and corrected for a small shift.

A shift that is too large is refused by `CameraShift.require_small`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array
from vision.background.camera_shift import CameraShift, as_calibrated, mean_shift, measure_shift
from vision.background.features import Background
from vision.camera.model import Camera, Image


@dataclass(frozen=True, eq=False)
class CameraWatch:
    """What images are compared with, and how large a shift is corrected.

    Attributes:
        background: taken with the camera as calibrated.
        distance: of the background along the optical axis, m.
        limit: largest shift at the background that is corrected, m.
    """

    background: Background
    distance: float
    limit: float

    def steady(self, images: Sequence[Image], camera: Camera) -> tuple[tuple[Image, ...], CameraShift]:
        """Return the images as the calibrated camera would have taken them, and its mean shift.

        Each image has its own shift, because a camera on a post sways from image to image.

        Raises:
            ImpossibleError: the camera has moved by more than `limit`, in another way than by a rotation, or too little
                of the background is recognised.
        """
        shifts = []
        for number, image in enumerate(images, start=1):
            camera.require_size(image, f"image {number} of {len(images)}")
            shifts.append(measure_shift(self.background, image, camera, self.distance))
            shifts[-1].require_small(self.limit)
        steadied = tuple(as_calibrated(i, camera, s) for i, s in zip(images, shifts, strict=True))
        return steadied, mean_shift(shifts)


def distance_to_plane(T_base_camera: Array, height: float) -> float:
    """Return the distance along the optical axis from the camera to a horizontal plane, m; inf if it looks past it.

    Args:
        T_base_camera: extrinsics, 4x4.
        height: of the plane in the base frame, m.
    """
    down = float(T_base_camera[2, 2])
    return (height - float(T_base_camera[2, 3])) / down if down < 0.0 else float(np.inf)
