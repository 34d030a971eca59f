"""Whether the images of one look show the same state of a hole.

`vision.occupancy.classify` judges the mean of all images, which is right for images of one moment only. Where a hole
looks different in some of them, each is judged alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from arm.poses import BoardPose
from vision.camera.frame_source import Image
from vision.camera.model import Camera
from vision.occupancy.classify import REACH, Occupancy, hole_occupancy
from vision.occupancy.edge_response import plate_view

PATCH = 2e-3  # m, over whose square greys are averaged: of the noise little is left
SWAY = 2e-3  # m, of edges between images
LEAST_CHANGE = 0.1  # of the contrast around the hole: a smaller change of grey is no cube


def agreed_occupancy(
    images: Sequence[Image], camera: Camera, pose: BoardPose, index: int, cube_size: float
) -> Occupancy:
    """Classify a hole as `hole_occupancy` does; unsure if one image surely shows a cube and another surely none."""
    if not _change(images, camera, pose, index):
        return hole_occupancy(images, camera, pose, index, cube_size)
    alone = [hole_occupancy([image], camera, pose, index, cube_size).state for image in images]
    cube, empty = (
        [str(n) for n, one in enumerate(alone, start=1) if one == state] for state in ("cube", "empty")
    )
    if not cube or not empty:
        return hole_occupancy(images, camera, pose, index, cube_size)
    why = f"of {len(images)} images a cube is in {_listed(cube)}, and none in {_listed(empty)}"
    return Occupancy("unsure", 0.5, f"{why}: they must be of one moment")


def _listed(numbers: Sequence[str]) -> str:
    return " and ".join([", ".join(numbers[:-1]), numbers[-1]] if numbers[:-1] else numbers)


def _change(images: Sequence[Image], camera: Camera, pose: BoardPose, index: int) -> bool:
    """Whether a part of a hole's surroundings has another grey in one image than in the first, exposure aside.

    A grey that is there in the first image within `SWAY` is no change: the camera, or a lamp, may sway a little.
    """
    T_base_hole = pose.holes[index].T_base_hole
    views = [plate_view([image], camera, T_base_hole, REACH) for image in images]
    low, high, least = np.zeros(0), np.zeros(0), 0.0
    for number, view in enumerate(views):
        if view is None:
            return False
        width, sway = (max(1, round(size * view.px_per_m())) for size in (PATCH, 2.0 * SWAY))
        grey = np.asarray(cv2.blur(view.grey, (width, width)), dtype=np.float32)
        grey = grey / max(float(np.mean(grey)), 1.0)
        if number:
            if (np.maximum(grey - high, low - grey) > least).any():
                return True
            continue
        kernel = np.ones((sway, sway), dtype=np.uint8)
        low, high = np.asarray(cv2.erode(grey, kernel)), np.asarray(cv2.dilate(grey, kernel))
        least = LEAST_CHANGE * float(np.ptp(np.percentile(grey, (1.0, 99.0))))
    return False
