"""Is there a cube in a hole? Decided by how bright the image is where a cube's top would be, and where the hole is.

Brightness is measured on the scale from the black to the white of the board's own markers, so that light and exposure
do not matter: a cube's top is light and even, an empty pocket dark. Cubes are taken to be lighter than pockets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt

from arm.board import CUBE_SEAT_DEPTH, POCKET_FLOOR, POCKET_MOUTH, Board
from arm.poses import BoardPose
from arm.se3 import Array, apply, inverse
from vision.camera import Camera
from vision.frames import Image

GRID = 21  # samples a side of a square
INNER = 0.7  # part of a square that is sampled: its edges, their blur and the pose's error stay outside
QUIET_ZONE = 1.0 / 6.0  # width of a marker's white border in marker sizes
LEAST_TELLING = 0.1  # part of a cube's top that must be seen in front of the mouth
LEAST_CONTRAST = 25.0  # grey levels between a marker's black and white, else nothing is sure
DARK, LIGHT = 0.40, 0.68  # levels between which it is neither a pocket nor a cube
EVEN = 0.25  # largest range of levels over a cube's top: what lies across it is not a cube
SURE = 0.8  # score of a cube; 1 minus it that of an empty hole


@dataclass(frozen=True)
class Occupancy:
    """What is in a hole.

    Attributes:
        state: "cube", "empty", or "unsure" where the image does not say.
        score: from 0 (surely empty) to 1 (surely a cube).
    """

    state: Literal["cube", "empty", "unsure"]
    score: float


UNSURE = Occupancy("unsure", 0.5)


def hole_occupancy(
    images: Sequence[Image], camera: Camera, pose: BoardPose, index: int, cube_size: float
) -> Occupancy:
    """What stands in hole `index` (0 to 3) of a board that was found.

    Args:
        images: photographs of one moment, grey or BGR, of the camera's size.
        camera: that took them.
        pose: of the board.
        index: of the hole.
        cube_size: edge of a cube, m.
    """
    hole = pose.board.holes[index]
    top = _square(hole + (0.0, 0.0, cube_size - CUBE_SEAT_DEPTH), INNER * cube_size)
    squares = [top, _square(hole, INNER * POCKET_FLOOR), *_marker_squares(pose.board)]
    pixels = [camera.project_base(apply(pose.T_base_board, square)) for square in squares]
    telling = _over_mouth(top, pose, camera, hole)
    if not all(_inside(p, camera) for p in pixels) or telling.mean() < LEAST_TELLING:
        return UNSURE
    top_grey, hole_grey, *marker_grey = (_mean_grey(images, p) for p in pixels)
    black, white = np.percentile(np.stack(marker_grey), (10.0, 90.0))
    if white - black < LEAST_CONTRAST:
        return UNSURE
    top_level, hole_level = ((g - black) / (white - black) for g in (top_grey, hole_grey))
    score, hole_light = _ramp(float(np.median(top_level[telling]))), _ramp(float(np.median(hole_level)))
    low, high = np.percentile(top_level, (5.0, 95.0))
    if score >= SURE and high - low <= EVEN:
        return Occupancy("cube", score)
    # seen at a slant, a cube hides its hole with a dark side: a dark hole alone does not speak against a cube
    if score <= 1.0 - SURE and hole_light <= 1.0 - SURE:
        return Occupancy("empty", score)
    return Occupancy("unsure", score)


def _over_mouth(top: Array, pose: BoardPose, camera: Camera, hole: Array) -> npt.NDArray[np.bool_]:
    """Which points (n, 3) of a cube's top are seen in front of the pocket's mouth: there, light means a cube."""
    eye = apply(inverse(pose.T_base_board), camera.T_base_camera[:3, 3])
    below = eye + (top - eye) * (eye[2] / (eye[2] - top[:, 2:]))  # where the rays meet the plate, z = 0
    return np.asarray(np.abs(below - hole).max(axis=-1) <= INNER * POCKET_MOUTH / 2.0)


def _square(centre: Array, width: float) -> Array:
    """Points (GRID^2, 3) m evenly over a square parallel to the board."""
    side = (np.arange(GRID) + 0.5) / GRID - 0.5
    x, y = np.meshgrid(width * side, width * side)
    return np.asarray(centre + np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3))


def _marker_squares(board: Board) -> list[Array]:
    """Both markers with their white borders."""
    width = board.marker_size * (1.0 + 2.0 * QUIET_ZONE)
    return [_square(outline.mean(axis=0), width) for outline in board.marker_corners()]


def _inside(pixels: Array, camera: Camera) -> bool:
    last = np.array(camera.size) - 1.0
    return bool((np.isfinite(pixels) & (pixels >= 0.0) & (pixels <= last)).all())


def _mean_grey(images: Sequence[Image], pixels: Array) -> npt.NDArray[np.float64]:
    """Grey levels at pixels (n, 2), averaged over the photographs, (n,)."""
    total = np.zeros(len(pixels))
    places = pixels.astype(np.float32)
    for image in images:
        values = np.asarray(cv2.remap(image, places[:, 0], places[:, 1], cv2.INTER_LINEAR), dtype=float)
        total += values.reshape(len(pixels), -1).mean(axis=1)
    return total / len(images)


def _ramp(level: float) -> float:
    return float(np.clip((level - DARK) / (LIGHT - DARK), 0.0, 1.0))
