"""``a465 doctor``: whether an image of the cell is sharp and exposed, by the markers in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cell.config.cell import Cell
from vision.camera.frame_source import Image
from vision.markers.detect import Marker, detect_markers
from vision.markers.edge_blur import SHARP_PX, marker_blur
from vision.markers.exposure import darkness, exposure_complaint


@dataclass(frozen=True)
class Sharpness:
    """Sharpness and exposure of an image.

    Attributes:
        markers: ids of the markers in it.
        blur_px: standard deviation of the blur at their borders, px; None: there is none, or they are too small.
        complaint: what is wrong, and what would help; "" if the image is sharp and exposed.
    """

    markers: tuple[int, ...]
    blur_px: float | None
    complaint: str


def judge_image(image: Image, cell: Cell) -> Sharpness:
    """Judge an image, grey (h, w) or BGR (h, w, 3), of the cell's camera.

    Raises:
        InputError: it is not of the camera's size.
    """
    markers = detect_markers(image, cell.camera, cell.dictionary)
    blur = marker_blur(image, markers, cell.dictionary)
    return Sharpness(tuple(m.id for m in markers), blur, _complaint(image, markers, blur))


def _complaint(image: Image, markers: Sequence[Marker], blur_px: float | None) -> str:
    if not markers:
        dark = darkness(image)
        return f"it shows {dark}" if dark else "no marker is in view: put a board where the camera sees it"
    if wrong := exposure_complaint(image, markers):
        return wrong
    if blur_px is None:
        return "the markers are too small to tell: put a board nearer to the camera"
    if blur_px > SHARP_PX:
        return f"blurred by {blur_px:.2f} px, more than {SHARP_PX:g}: focus, or expose for a shorter time"
    return ""
