"""Dictionaries of markers, by OpenCV's names."""

from __future__ import annotations

import cv2

from arm.errors import InputError


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
