"""Dictionaries of markers, by OpenCV's names, and what their markers look like."""

from __future__ import annotations

import cv2
import numpy as np

from arm.errors import InputError
from arm.se3 import Bools


def dictionary_names() -> list[str]:
    """All names in OpenCV."""
    return sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_"))


def predefined(name: str) -> cv2.aruco.Dictionary:
    """The dictionary of that name.

    Raises:
        InputError: there is none; the message lists the choices.
    """
    known = dictionary_names()
    if name not in known:
        raise InputError(
            f"dictionary = {name!r}: must be one of {', '.join(known)}", dictionary=name, choices=known
        )
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def marker_modules(dictionary: str, marker_id: int) -> Bools:
    """Return the modules (m, m) of a marker with its black border, True for white; row 0 is at its top.

    Raises:
        InputError: OpenCV has no such dictionary, or the dictionary no such id.
    """
    known = predefined(dictionary)
    count = len(known.bytesList)
    if not 0 <= marker_id < count:
        raise InputError(
            f"marker id = {marker_id}: must be from 0 to {count - 1} in {dictionary}", marker_id=marker_id
        )
    return np.asarray(known.generateImageMarker(marker_id, known.markerSize + 2, borderBits=1) > 127)
