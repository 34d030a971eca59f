"""Whether photographs are too bright or too dark for corners to be measured well, by the markers in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.camera.frame_source import Image
from vision.markers.detect import Marker

SATURATED = 255  # grey
DARK = 50  # grey: nothing is seen in a photograph without a brighter pixel; twelve bits in sixteen are read as below 16
BORDER = 4.0 / 3.0  # a marker of 6 modules with its white border, by the marker alone
# On rendered 36 mm markers, corners are 0.017 px off where all is well, 0.14 px if exposed 1.2 times too long (half of
# the white is saturated), 0.8 px if 2 times, and 0.09 px with a contrast of 33 grey.
MOST_SATURATED = 0.05
LEAST_CONTRAST = 40.0  # grey


@dataclass(frozen=True)
class MarkerBrightness:
    """Light and dark of one marker.

    Attributes:
        id: of the marker.
        saturated: share of its white that is at the top of the scale, so that nobody knows how bright it was.
        white, black: typical greys of its light and dark parts.
    """

    id: int
    saturated: float
    white: float
    black: float

    def complaint(self) -> str | None:
        """What is wrong with the exposure, in words for a person; None if nothing is."""
        if self.saturated > MOST_SATURATED:
            return (
                f"too bright: {100.0 * self.saturated:.0f} % of the white of marker {self.id} is saturated, "
                "which moves corners; less exposure or gain"
            )
        if self.white - self.black < LEAST_CONTRAST:
            return (
                f"too dark: marker {self.id} is {self.white:.0f} grey where it is white and {self.black:.0f} where "
                "it is black; more light, exposure or gain"
            )
        return None


def darkness(image: Image) -> str | None:
    """That a photograph, grey or BGR, is black, in words for a person; None if it is not."""
    if image.max() >= DARK:
        return None
    return f"nothing brighter than {image.max()} of 255: expose longer, or write photographs of 8 bits"


def marker_brightness(image: Image, markers: Sequence[Marker]) -> tuple[MarkerBrightness, ...]:
    """How bright each marker is in its photograph.

    Args:
        image: grey (h, w) or BGR (h, w, 3).
        markers: that were found in it.
    """
    found = []
    for marker in markers:
        centre = marker.corners_px.mean(axis=0)
        outline = np.rint(centre + BORDER * (marker.corners_px - centre)).astype(np.int32)
        low = np.maximum(outline.min(axis=0), 0)
        part = image[low[1] : outline[:, 1].max() + 1, low[0] : outline[:, 0].max() + 1]
        grey = part if part.ndim == 2 else np.asarray(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        mask = np.zeros(grey.shape, np.uint8)
        cv2.fillConvexPoly(mask, outline - low.astype(np.int32), 1)
        values = grey[mask == 1]
        black, white = np.percentile(values, (10.0, 90.0))
        light = values[values > (black + white) / 2.0]
        saturated = float(np.mean(light >= SATURATED)) if light.size else 0.0
        found.append(MarkerBrightness(marker.id, saturated, float(white), float(black)))
    return tuple(found)


def exposure_complaint(image: Image, markers: Sequence[Marker]) -> str | None:
    """What is wrong with the exposure of a photograph, by its worst marker; None if nothing is."""
    found = sorted(marker_brightness(image, markers), key=lambda m: (-m.saturated, m.white - m.black))
    told = [words for marker in found if (words := marker.complaint()) is not None]
    return told[0] if told else None
