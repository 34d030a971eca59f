"""Draw on images at sub-pixel positions."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from vision.camera.frame_source import Image

Colour = tuple[int, int, int]  # blue, green, red
TEXT_HEIGHT = 1.0 / 64.0  # of capitals, relative to the image width: 10 px in a report with images of 640 px
_CAPITALS = 21.5  # height of OpenCV's font at scale 1, px
SHIFT = 4  # fractional bits of OpenCV's drawing coordinates


class Pen:
    """Draws on an image; skips what is not finite (behind the camera) or far outside."""

    def __init__(self, picture: Image) -> None:
        """
        Args:
            picture: BGR (h, w, 3), drawn on in place.
        """
        self._picture = picture
        self._width = max(1, picture.shape[1] // 800)

    def _fixed(self, points: Array) -> npt.NDArray[np.int32] | None:
        if not np.isfinite(points).all() or np.abs(points).max() > 1e5:
            return None
        return np.asarray(np.rint(points * 2**SHIFT), dtype=np.int32)

    def outline(self, corners: Array, colour: Colour) -> None:
        """Draw a closed line through corners (n, 2) px."""
        points = self._fixed(corners)
        if points is not None:
            cv2.polylines(self._picture, [points], True, colour, self._width, cv2.LINE_AA, SHIFT)

    def arrow(self, start: Array, end: Array, colour: Colour) -> None:
        """Draw an arrow from start to end, (2,) px each."""
        points = self._fixed(np.stack([start, end]))
        if points is not None:
            a, b = (tuple(map(int, p)) for p in points)
            cv2.arrowedLine(self._picture, a, b, colour, self._width, cv2.LINE_AA, SHIFT, 0.15)

    def text(self, words: str, centre: Array, colour: Colour) -> None:
        """Draw lines of text centred at (2,) px, readable on any background and in small images."""
        if self._fixed(centre) is None:
            return
        lines = words.split("\n")
        height = TEXT_HEIGHT * self._picture.shape[1]
        scale, thick = height / _CAPITALS, max(1, round(height / 9.0))
        for number, line in enumerate(lines):
            (width, _), _ = cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, scale, thick)
            below = (number - (len(lines) - 1) / 2.0) * 1.6 * height
            place = (int(centre[0] - width / 2), int(centre[1] + height / 2 + below))
            for shade, wide in (((255, 255, 255), 3 * thick), (colour, thick)):
                cv2.putText(
                    self._picture, line, place, cv2.FONT_HERSHEY_SIMPLEX, scale, shade, wide, cv2.LINE_AA
                )
