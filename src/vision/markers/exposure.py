"""Judge by the markers in images whether these are too bright or too dark to measure corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from vision.camera.frame_source import Image
from vision.markers.detect import Marker

SATURATED = 255  # grey
DARK = 50  # grey; an image without a brighter pixel is black; 12 bits stored in 16 read as below 16
BORDER = 4.0 / 3.0  # size of a marker of 6 modules with its white border, relative to the marker
# On rendered 36 mm markers, corners are off by 0.017 px at best, 0.14 px at 1.2 times the exposure (half of the white
# is saturated), 0.8 px at 2 times, and 0.09 px at a contrast of 33 grey.
MOST_SATURATED = 0.05
LEAST_CONTRAST = 40.0  # grey


@dataclass(frozen=True)
class MarkerBrightness:
    """Brightness of one marker.

    Attributes:
        id: of the marker.
        saturated: fraction of its white that is saturated, so that its brightness is unknown.
        white, black: typical greys of its light and dark parts.
    """

    id: int
    saturated: float
    white: float
    black: float

    def complaint(self) -> str | None:
        """What is wrong with the exposure, in words; None if nothing is."""
        if self.saturated > MOST_SATURATED:
            return (
                f"too bright: {100.0 * self.saturated:.0f} % of the white of marker {self.id} is saturated, "
                "which shifts corners; reduce exposure or gain"
            )
        if self.white - self.black < LEAST_CONTRAST:
            return (
                f"too dark: marker {self.id} has {self.white:.0f} grey in its white and {self.black:.0f} in its black "
                "parts; increase light, exposure or gain"
            )
        return None


def darkness(image: Image) -> str | None:
    """Describe an image, grey or BGR, as black; None if it is not."""
    if image.max() >= DARK:
        return None
    return f"nothing brighter than {image.max()} of 255: expose longer, or write 8-bit images"


def marker_brightness(image: Image, markers: Sequence[Marker]) -> tuple[MarkerBrightness, ...]:
    """Measure the brightness of each marker.

    Args:
        image: grey (h, w) or BGR (h, w, 3).
        markers: detected in it.
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
    """What is wrong with the exposure of an image, by its worst marker; None if nothing is."""
    found = sorted(marker_brightness(image, markers), key=lambda m: (-m.saturated, m.white - m.black))
    return next((words for marker in found if (words := marker.complaint()) is not None), None)
