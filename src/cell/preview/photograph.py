"""A photograph for the page, as an ideal lens would have taken it."""

from __future__ import annotations

from base64 import b64encode

import cv2
import numpy as np

from vision.camera.frame_source import as_grey
from vision.camera.model import Camera, Image

WIDEST = 960  # px; the page draws it smaller
QUALITY = 70  # of JPEG


def photograph_url(camera: Camera, image: Image) -> str:
    """Return an image without the lens's distortion, in grey and at most `WIDEST` wide, as a data URL of a JPEG.

    Args:
        camera: that took it.
        image: grey (h, w) or BGR (h, w, 3).

    Raises:
        InputError: the image has not the camera's size.
    """
    camera.require_size(image, "the photograph")
    flat = cv2.undistort(as_grey(image), camera.K, camera.distortion)
    share = min(1.0, WIDEST / flat.shape[1])
    small = cv2.resize(flat, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    data = np.asarray(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])
    return f"data:image/jpeg;base64,{b64encode(data.tobytes()).decode()}"
