"""Judge by the markers in images whether these are too bright or too dark to measure corners."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from vision.camera.frame_source import Image, as_grey
from vision.markers.detect import Marker

SATURATED = 255  # grey
DARK = 50  # grey; an image without a brighter pixel is black; 12 bits stored in 16 read as below 16
BORDER = 4.0 / 3.0  # size of a marker of 6 modules with its white border, relative to the marker
# On rendered 36 mm markers, corners are off by 0.017 px at best, 0.14 px at 1.2 times the exposure (half of the white
# is saturated), 0.8 px at 2 times, and 0.09 px at a contrast of 33 grey.
MOST_SATURATED = 0.05
MOST_WHITE = 0.9  # of an image: what is left has no room for two markers with their surroundings
LEAST_CONTRAST = 40.0  # grey


def darkness(image: Image) -> str | None:
    """Describe an image, grey or BGR, as black; None if it is not."""
    if image.max() >= DARK:
        return None
    return f"nothing brighter than {image.max()} of 255: expose longer, or write 8-bit images"


def whiteness(image: Image) -> str | None:
    """Describe an image, grey or BGR, as white: without a marker's black; None if it is not."""
    if (saturated := float(np.mean(as_grey(image) >= SATURATED))) < MOST_WHITE:
        return None
    return f"almost nothing but white: {100.0 * saturated:.0f} % is saturated; reduce exposure or gain"


def exposure_complaint(image: Image, markers: Sequence[Marker]) -> str | None:
    """What is wrong with the exposure of an image, by its worst marker; None if nothing is.

    Args:
        image: grey (h, w) or BGR (h, w, 3).
        markers: detected in it.
    """
    found = [(marker.id, *_brightness(image, marker)) for marker in markers]
    for number, saturated, white, black in sorted(found, key=lambda m: (-m[1], m[2] - m[3])):
        if saturated > MOST_SATURATED:
            return (
                f"too bright: {100.0 * saturated:.0f} % of the white of marker {number} is saturated, which shifts "
                "corners; reduce exposure or gain"
            )
        if white - black < LEAST_CONTRAST:
            return (
                f"too dark: marker {number} has {white:.0f} grey in its white and {black:.0f} in its black parts; "
                "increase light, exposure or gain"
            )
    return None


def _brightness(image: Image, marker: Marker) -> tuple[float, float, float]:
    """Saturated fraction of a marker's white, whose brightness is then unknown; typical greys of white and black."""
    centre = marker.corners_px.mean(axis=0)
    outline = np.rint(centre + BORDER * (marker.corners_px - centre)).astype(np.int32)
    low = np.maximum(outline.min(axis=0), 0)
    grey = as_grey(image[low[1] : outline[:, 1].max() + 1, low[0] : outline[:, 0].max() + 1])
    mask = np.zeros(grey.shape, np.uint8)
    cv2.fillConvexPoly(mask, outline - low.astype(np.int32), 1)
    values = grey[mask == 1]
    black, white = np.percentile(values, (10.0, 90.0))
    light = values[values > (black + white) / 2.0]
    saturated = float(np.mean(light >= SATURATED)) if light.size else 0.0
    return saturated, float(white), float(black)
